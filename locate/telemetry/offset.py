"""The time between a video and its telemetry, from the speed of the camera in both.

Two profiles of the same motion, one of them in unknown units, are shifted until they agree best;
what is reported is the shift with the highest correlation, how well the next best does, and the
standard deviation that the remaining disagreement leaves.
"""

from dataclasses import dataclass, replace
from math import atanh, isfinite, log, sqrt

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from geometry.arrays import BoolArray, FloatArray
from geometry.errors import BadInputError
from locate.telemetry.profiles import (
    MIN_LENGTH_S,
    STEP_S,
    WINDOW_S,
    clip_spikes,
    smooth_profile,
    speed_profile,
    time_grid,
    turn_profile,
)
from locate.telemetry.resample import interpolate
from locate.telemetry.track import TelemetryTrack

MIN_COVERED = 0.5
"""Share of the camera path that the track must overlap; chosen."""
MAX_CHANCE = 0.01
"""Largest probability that unrelated profiles agree as well; chosen."""
MIN_LEAD_NATS = 7.0
"""Least log-likelihood by which the best shift must beat any other; chosen."""
_TAPER_S = 3.0
"""Lags up to which the errors of the fit may be correlated; chosen."""
_LOBE_S = 2.0
"""Shifts this near to the best one belong to its peak; chosen."""


@dataclass(frozen=True, kw_only=True)
class TimeOffset:
    """``telemetry time = video time + offset_s``.

    Attributes:
        offset_s: The shift at which the profiles agree best.
        sigma_s: Its standard deviation.
        correlation: Of the two profiles there, 0 to 1.
        rival: The best correlation at any other shift, outside of the peak itself.
        lead_nats: Log-likelihood by which the best shift beats that rival.
        chance: Probability that unrelated profiles agree as well somewhere in the search.
    """

    offset_s: float
    sigma_s: float
    correlation: float
    rival: float
    lead_nats: float
    chance: float


def estimate_offset(
    track: TelemetryTrack,
    stamps_s: ArrayLike,
    speeds: ArrayLike,
    *,
    search_s: tuple[float, float] | None = None,
) -> TimeOffset:
    """The offset at which the speed of the camera's path fits that of the track.

    Args:
        track: Records with times.
        stamps_s: (M,) ascending times of the frames.
        speeds: (M,) speed of the camera there, in any unit; see `path_speeds`.
        search_s: Lowest and highest offset; by default all with enough overlap.

    Raises:
        BadInputError: The profiles do not determine it: too short, too even, or as good elsewhere.
    """
    start_s, profile = speed_profile(track)
    return _match_profiles(track, start_s, profile, stamps_s, speeds, search_s)


def estimate_offset_from_turns(
    track: TelemetryTrack,
    stamps_s: ArrayLike,
    turns_dps: ArrayLike,
    *,
    search_s: tuple[float, float] | None = None,
) -> TimeOffset:
    """The same from how fast the camera turned, for tracks with gimbal or vehicle angles.

    Args:
        track: Records with times and angles.
        stamps_s: (M,) ascending times of the frames.
        turns_dps: (M,) deg/s; see `path_turns_dps`.
        search_s: Lowest and highest offset.

    Raises:
        BadInputError: The profiles do not determine it, or the track has no angles.
    """
    start_s, profile = turn_profile(track)
    return _match_profiles(track, start_s, profile, stamps_s, turns_dps, search_s)


def _match_profiles(
    track: TelemetryTrack,
    start_s: float,
    profile: FloatArray,
    stamps_s: ArrayLike,
    values: ArrayLike,
    search_s: tuple[float, float] | None,
) -> TimeOffset:
    stamps, camera = np.asarray(stamps_s, dtype=float), np.asarray(values, dtype=float)
    grid_s = time_grid(stamps[0], stamps[-1], "the camera path")
    if np.isfinite(profile).sum() * STEP_S < MIN_LENGTH_S:
        raise BadInputError(f"{track.path}: too full of gaps to find a time offset")
    camera = clip_spikes(smooth_profile(interpolate(grid_s, stamps, camera, np.inf)))
    correlation, overlap = _sliding_correlation(camera, profile)
    shifts = np.arange(len(correlation)) - (len(camera) - 1)
    offsets_s = shifts * STEP_S + start_s - grid_s[0]
    allowed = overlap * STEP_S >= max(MIN_LENGTH_S, MIN_COVERED * len(camera) * STEP_S)
    if search_s is not None:
        allowed &= (offsets_s >= search_s[0]) & (offsets_s <= search_s[1])
    correlation = np.where(allowed, correlation, -1.0)
    best = int(np.argmax(correlation))
    rows = np.arange(max(0, -shifts[best]), min(len(camera), len(profile) - shifts[best]))
    rows = rows[np.isfinite(profile[rows + shifts[best]])]
    peak = _peak_region(correlation, best)
    x, y = camera[rows], profile[rows + shifts[best]]
    found = TimeOffset(
        offset_s=float(offsets_s[best]) + STEP_S * _peak_vertex(correlation, best),
        sigma_s=_sigma_s(x, np.gradient(camera, STEP_S)[rows], y),
        correlation=float(correlation[best]),
        rival=float(np.max(np.where(peak, -1.0, correlation))),
        lead_nats=0.0,
        chance=_false_match_probability(x, y, float(correlation[best]), int(allowed.sum())),
    )
    found = replace(found, lead_nats=_lead_nats(found, x, y))
    if found.chance > MAX_CHANCE or found.lead_nats < MIN_LEAD_NATS or not isfinite(found.sigma_s):
        raise BadInputError(
            f"{track.path}: the motion does not determine the time offset to the video "
            f"(correlation {found.correlation:.2f}, elsewhere {found.rival:.2f}, "
            f"by chance with probability {found.chance:.2g}); give it with --telemetry-offset, "
            "or fly less evenly"
        )
    return found


def _sliding_correlation(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pearson correlation of (M,) `x` with each part of (N,) `y`, NaN apart, and their overlap.

    Returns:
        (M + N - 1,) of each; element M - 1 has the two starts on each other.
    """
    known = np.isfinite(y).astype(float)
    y = np.where(known > 0, y - np.nanmean(y), 0.0)
    x, ones = x - x.mean(), np.ones(len(x))
    n = np.maximum(_cross_correlate(known, ones).round(), 1.0)
    sum_x, sum_y = _cross_correlate(known, x), _cross_correlate(y, ones)
    variance_x = np.maximum(n * _cross_correlate(known, x * x) - sum_x**2, 0.0)
    variance_y = np.maximum(n * _cross_correlate(y * y, ones) - sum_y**2, 0.0)
    size = np.sqrt(variance_x * variance_y)
    floor = 1e-9 * max(float(size.max()), 1e-30)
    product = n * _cross_correlate(y, x) - sum_x * sum_y
    return np.where(size > floor, product / np.maximum(size, floor), 0.0).clip(-1, 1), n


def _cross_correlate(a: FloatArray, b: FloatArray) -> FloatArray:
    """(M + N - 1,) of (M,) a and (N,) b, at all shifts."""
    from scipy.signal import correlate  # a second to import, which few runs need

    return np.asarray(correlate(a, b, mode="full", method="fft"))


def _peak_region(correlation: FloatArray, best: int) -> BoolArray:
    """The shifts that belong to the peak: as far as it falls, and at least `_LOBE_S`."""
    falling = np.diff(correlation) < 0
    stop = best + int(np.argmin(np.append(falling[best:], False)))
    rising = ~falling[:best][::-1]
    start = best - int(np.argmin(np.append(rising, False)))
    reach, shifts = round(_LOBE_S / STEP_S), np.arange(len(correlation))
    return (shifts >= min(start, best - reach)) & (shifts <= max(stop, best + reach))


def _peak_vertex(correlation: FloatArray, best: int) -> float:
    """Where between the samples the parabola through the peak is highest, -0.5 to 0.5."""
    if not 0 < best < len(correlation) - 1:
        return 0.0
    before, peak, after = correlation[best - 1 : best + 2]
    bend = before - 2 * peak + after
    return float(np.clip((before - after) / (2 * bend), -0.5, 0.5)) if bend < 0 else 0.0


def _fit_residuals(y: FloatArray, x: FloatArray) -> FloatArray:
    """What is left of y after the best a x + b."""
    basis = np.column_stack([x, np.ones(len(x))])
    return np.asarray(y - basis @ np.linalg.lstsq(basis, y, rcond=None)[0])


def _sigma_s(x: FloatArray, slope: FloatArray, y: FloatArray) -> float:
    """Standard deviation of the shift in y(t) = a x(t + shift) + b; `slope` is that of x.

    Errors may depend on their neighbours: Newey and West, Econometrica 1987, eq. 5.
    """
    gain = np.cov(x, y)[0, 1] / max(float(np.var(x, ddof=1)), 1e-30)
    influence = gain * _fit_residuals(slope, x)
    information = float(influence @ influence)
    power = max(_long_run_variance(influence * _fit_residuals(y, x)), 0.0)
    return sqrt(power) / information if information > 0 else np.inf


def _long_run_variance(values: FloatArray) -> float:
    """Sum of the autocovariances up to `_TAPER_S`, Bartlett weights, times the length."""
    reach = min(round(_TAPER_S / STEP_S), len(values) - 1)
    lags = [float(values[k:] @ values[: len(values) - k]) for k in range(reach + 1)]
    weights = 1 - np.arange(1, reach + 1) / (reach + 1)
    return lags[0] + 2 * float(weights @ lags[1:])


def _lead_nats(found: TimeOffset, x: FloatArray, y: FloatArray) -> float:
    ratio = (1 - max(found.rival, 0.0) ** 2) / max(1 - found.correlation**2, 1e-12)
    independent = len(x) / max(_correlation_length(_fit_residuals(y, x)), WINDOW_S / STEP_S)
    return 0.5 * independent * log(ratio) if ratio > 0 else 0.0


def _correlation_length(values: FloatArray) -> float:
    """Samples that count as one, by the autocorrelation up to where it first is negative.

    Source: Geyer, Statistical Science 1992, section 3.3, the initial positive sequence.
    """
    lags = _autocorrelation(values)
    end = int(np.argmax(lags < 0)) or len(lags)
    return float(1 + 2 * lags[1:end].sum())


def _false_match_probability(
    x: FloatArray, y: FloatArray, correlation: float, shifts: int
) -> float:
    """Probability of such a peak without any relation (Bartlett 1935; Fisher's z)."""
    memory = max(_joint_correlation_length(x, y), 1.0)
    independent = len(x) / memory - 3
    if independent <= 0 or correlation >= 1:
        return 1.0 if independent <= 0 else 0.0
    one = float(ndtr(-atanh(max(correlation, 0.0)) * sqrt(independent)))
    return float(-np.expm1(max(shifts / memory, 1.0) * np.log1p(-one)))


def _joint_correlation_length(x: FloatArray, y: FloatArray) -> float:
    """Samples that count as one: the sum over all lags of both autocorrelations' product."""
    product = _autocorrelation(x) * _autocorrelation(y)
    return float(1 + 2 * product[1 : max(len(x) // 2, 2)].sum())


def _autocorrelation(values: FloatArray) -> FloatArray:
    centred = values - values.mean()
    lags = _cross_correlate(centred, centred)[len(values) - 1 :]
    return np.asarray(lags / max(lags[0], 1e-30))
