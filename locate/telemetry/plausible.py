"""Positions held against their neighbours: what no vehicle can have done is left out or noted."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from geometry.arrays import BoolArray, FloatArray, IntArray
from locate.telemetry.resample import wrap_angles
from locate.telemetry.track import METRES_PER_DEGREE, file_name

MAX_SPEED_MPS = 150.0
"""No vehicle that films a scene is faster; chosen."""
SLACK_M = 200.0
"""A receiver may be so far off, or round so coarsely, between two records; chosen."""
PHOTOS_REACH_M = 100_000.0
"""Photos of one scene are nearer than this to their median; chosen."""
FEW = 0.1
"""Up to this share of the records may be left out at an end, or of photos; chosen."""


def find_strays(
    latitude_deg: FloatArray, longitude_deg: FloatArray, times_s: FloatArray
) -> BoolArray:
    """Records between others that fit each other, to which they cannot belong.

    Args:
        latitude_deg: (N,) NaN where not known.
        longitude_deg: (N,).
        times_s: (N,) ascending.

    Returns:
        (N,) true for the records that are to be left out.
    """
    stray = np.zeros(len(times_s), dtype=bool)
    known = np.flatnonzero(np.isfinite(latitude_deg))
    jumps = find_jumps(latitude_deg[known], longitude_deg[known], times_s[known])
    runs = np.split(known, jumps)
    for index, run in enumerate(runs[1:-1], start=1):
        before, after = runs[index - 1], runs[index + 1]
        ends = np.array([before[-1], after[0]])
        fits = not len(find_jumps(latitude_deg[ends], longitude_deg[ends], times_s[ends]))
        stray[run] = fits and len(run) < min(len(before), len(after))
    for run in (runs[0], runs[-1]):
        stray[run] |= len(run) <= FEW * len(known)
    return stray


def find_jumps(
    latitude_deg: FloatArray, longitude_deg: FloatArray, times_s: FloatArray
) -> IntArray:
    """Indices of the records that cannot be reached from the one before, all positions known."""
    steps_m = _distances_m(
        latitude_deg[:-1], longitude_deg[:-1], latitude_deg[1:], longitude_deg[1:]
    )
    return np.flatnonzero(steps_m > SLACK_M + MAX_SPEED_MPS * np.diff(times_s)) + 1


def leave_out_strays(
    path: Path,
    latitude_deg: FloatArray,
    longitude_deg: FloatArray,
    times_s: FloatArray | None,
    names: Sequence[str],
) -> list[str]:
    """Sets positions that cannot be to NaN, in place.

    Args:
        path: The file.
        latitude_deg: (N,) changed in place.
        longitude_deg: (N,) changed in place.
        times_s: (N,) ascending; None for photos.
        names: (N,) photos.

    Returns:
        What was left out, and what cannot be and stays since it is not known which part is wrong.
    """
    if times_s is None:
        return _leave_out_far_photos(path, latitude_deg, longitude_deg, names)
    notes = []
    stray = find_strays(latitude_deg, longitude_deg, times_s)
    if stray.any():
        latitude_deg[stray] = longitude_deg[stray] = np.nan
        notes.append(
            f"{path.name}: {int(stray.sum())} of {len(stray)} positions were left out, as no "
            f"vehicle gets there and back (the first at {times_s[stray][0]:.2f} s)"
        )
    known = np.flatnonzero(np.isfinite(latitude_deg))
    jumps = known[find_jumps(latitude_deg[known], longitude_deg[known], times_s[known])]
    if len(jumps):
        notes.append(
            f"{path.name}: {len(jumps)} of the steps between its positions are longer than any "
            f"vehicle goes (the first at {times_s[jumps[0]]:.2f} s); check its positions and times"
        )
    return notes


def leave_out_namesakes(
    path: Path, latitude_deg: FloatArray, longitude_deg: FloatArray, names: Sequence[str]
) -> list[str]:
    """Sets the positions of photos of one file name (in two folders) to NaN where they differ.

    Args:
        path: The file.
        latitude_deg: (N,) changed in place.
        longitude_deg: (N,) changed in place.
        names: (N,) photos, perhaps with their folders.

    Returns:
        How many were left out.
    """
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        if np.isfinite(latitude_deg[row]):
            rows.setdefault(file_name(name), []).append(row)
    left_out = 0
    for same in rows.values():
        if np.ptp(latitude_deg[same]) > 0 or np.ptp(longitude_deg[same]) > 0:
            latitude_deg[same] = longitude_deg[same] = np.nan
            left_out += len(same)
    if not left_out:
        return []
    return [
        f"{path.name}: {left_out} positions were left out, as several photos of one name have "
        "different ones; keep the rows of this recording only"
    ]


def _leave_out_far_photos(
    path: Path, latitude_deg: FloatArray, longitude_deg: FloatArray, names: Sequence[str]
) -> list[str]:
    known = np.flatnonzero(np.isfinite(latitude_deg))
    if len(known) < 2:
        return []
    first_deg = longitude_deg[known[0]]
    median_deg = first_deg + np.median(wrap_angles(longitude_deg[known] - first_deg))
    middle = np.median(latitude_deg[known])
    far = known[
        _distances_m(latitude_deg[known], longitude_deg[known], middle, median_deg) > PHOTOS_REACH_M
    ]
    if not len(far):
        return []
    text = (
        f"{path.name}: {len(far)} of {len(known)} positions are over "
        f"{PHOTOS_REACH_M / 1000:.0f} km from the others (the first: {names[far[0]]})"
    )
    if len(far) > FEW * len(known):
        return [f"{text}; check their signs and hemispheres"]
    latitude_deg[far] = longitude_deg[far] = np.nan
    return [f"{text}; they were left out"]


def _distances_m(
    latitude_deg: FloatArray,
    longitude_deg: FloatArray,
    other_latitude_deg: FloatArray | float,
    other_longitude_deg: FloatArray | float,
) -> FloatArray:
    """On a sphere, by the haversine."""
    one, other = np.radians(latitude_deg), np.radians(other_latitude_deg)
    turn = np.radians(np.asarray(longitude_deg) - other_longitude_deg)
    square = np.sin((one - other) / 2) ** 2 + np.cos(one) * np.cos(other) * np.sin(turn / 2) ** 2
    return np.asarray(2 * np.degrees(np.arcsin(np.sqrt(square.clip(0, 1)))) * METRES_PER_DEGREE)
