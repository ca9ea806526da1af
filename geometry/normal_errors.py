"""Robust statistics of normal errors against their standard deviation."""

MAD_TO_SIGMA = 1.4826
"""Standard deviation per median absolute deviation."""
MEDIAN_SPREAD = 1.2533
"""Standard deviation of a median over that of a mean: sqrt(pi / 2)."""
