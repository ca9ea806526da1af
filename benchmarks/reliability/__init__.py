"""Whether the probability that a map states is true: a hundred recordings, with plumes or without.

    python -m benchmarks.reliability film   --work work/stated [--flows K...]
    python -m benchmarks.reliability score  --work work/stated [--flows K...]
    python -m benchmarks.reliability report --work work/stated [--plot reliability.png]

Random plants of the seeds 320000 to 320099, which nothing was trained or tuned on, on an arc of 20
to 60 degrees in 24 frames of 320x240 px, 8 of them key frames, noise 0.5 to 3 of 255, poses off by
0.03 degrees and 5 mm. Four in ten are drawn without a plume, the others have one of 0.05 to 1 px. A
plume's flow takes longest to make: plants of seeds 20 apart share one, each with an exit, wind,
strength and views of its own. `film` keeps what the work folder holds, and so does `score`:
delete `*.json` there when the method has changed.

A column or plume is true where its axis passes within 15 % of the range of the true one's, at a
height that both have. Without a plume the same is asked of the place where it would have stood.
"""
