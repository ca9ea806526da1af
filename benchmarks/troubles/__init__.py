"""Recordings that are spoilt after they were taken, real ones too, and what runs find in them.

    python -m benchmarks.troubles run                        # the bundled sample: a plume, truth
    python -m benchmarks.troubles film work/no_plume         # the same without its plume
    python -m benchmarks.troubles run work/no_plume/video.mkv
    python -m benchmarks.troubles run RECORDING... --troubles rain night

A recording is a video or a folder of frames; where truth.json lies beside it, sources are held
against it. What moves in a scene is simulated by `benchmarks.scenes orbit --nuisances`.
"""
