"""This project beside what else could be used, on the same input in the same run.

Peers that are no dependency of the project are in `benchmarks/peers/requirements.txt`; one that is
not installed is left out and named. CPU seconds are of one thread, medians of five rounds in which
all take turns; "of ours" is the median of the ratios within a round.
"""
