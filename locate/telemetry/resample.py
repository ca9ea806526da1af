"""Values between the times at which they were recorded."""

import numpy as np

from geometry.arrays import FloatArray


def interpolate(
    times_s: FloatArray,
    known_s: FloatArray,
    values: FloatArray,
    max_gap_s: float,
    *,
    period: float | None = None,
) -> FloatArray:
    """Linear interpolation that admits what it does not know.

    Args:
        times_s: (M,) wanted times.
        known_s: (N,) ascending times of the records.
        values: (N,) records; NaN ones are passed over.
        max_gap_s: Between records further apart than this the result is NaN.
        period: For angles: 360 goes the short way round and returns [-180, 180).

    Returns:
        (M,); NaN outside of the records.
    """
    finite = np.isfinite(values)
    if not finite.any():
        return np.full(len(times_s), np.nan)
    known_s, values = known_s[finite], values[finite]
    if period is not None:
        values = np.unwrap(values, period=period)
    found = np.interp(times_s, known_s, values, left=np.nan, right=np.nan)
    after = np.searchsorted(known_s, times_s).clip(max=len(known_s) - 1)
    gap_s = known_s[after] - known_s[np.maximum(after - 1, 0)]
    found[(gap_s > max_gap_s) & (known_s[after] != times_s)] = np.nan
    return found if period is None else wrap_angles(found, period)


def wrap_angles(values: FloatArray, period: float = 360.0) -> FloatArray:
    """The same angles in [-period / 2, period / 2)."""
    outside = (values < -period / 2) | (values >= period / 2)
    return np.where(outside, (values + period / 2) % period - period / 2, values)
