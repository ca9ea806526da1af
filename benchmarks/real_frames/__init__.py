"""Plumes of known strength rendered onto real recordings at their full size, and what runs find.

    python -m benchmarks.real_frames film  [RECORDING...] --work work/real_frames
    python -m benchmarks.real_frames run   [RECORDING...] --work work/real_frames [--poses film]
    python -m benchmarks.real_frames table [RECORDING...] --work work/real_frames

A recording is a folder of frames of a moving camera, in order; by default all of
../shared/data/2_dense_video. `film` runs `locate run` on each as it is: that is the case without a
plume, and its poses and sparse points place the plumes. Six plumes each are rendered onto it, by
turns far before their background and near it, 0.1, 0.3 and 1 px strong. `run` runs `locate run` on
each and scores it; `table` prints the scores and writes scores.jsonl.

A folder with `1px/frames`, `1px/truth` and `1px/truth.json`, as `locate simulate --onto` writes
them, and other strengths beside it, is filmed already: it is only run and scored.

A case is a folder and is skipped once it is done; delete its `score_*.json` when the method has
changed. The work folder holds copies of the frames: leave it out of what you publish.
"""
