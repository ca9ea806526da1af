"""What the registered detector sees, and what its network adds to scores made by hand.

    OMP_NUM_THREADS=1 python -m benchmarks.registered render FOLDER [--scenes 6]
    ... table NETWORK.onnx FOLDER
    ... clips NETWORK.onnx CLIPS... [--seeds FIRST END]...
    ... speed NETWORK.onnx [--run RUN]
    ... pixels SIMULATION... [--pose-errors 0 0.03 0.1] [--frames 5]

Of clips: a pixel is positive where |w| exceeds 0.3 of the
plume's amplitude, negative where it is below 0.01 px, neither in between; sky and everything that
is not measured counts as neither. `plain` is `registered-plain`. EPE is the mean error over
positives, beside that of an answer of zero. The reliability says what a stated llr is worth: the
log of the share of positives over the share of negatives whose llr lies there, and by how much
that scatters (standard deviation) where as many recordings are drawn from these with replacement;
plants of one seed count as one recording.
"""
