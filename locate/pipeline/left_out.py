"""Which key frames a map does without, and why, as far as that is known."""

import numpy as np

from geometry.arrays import BoolArray, IntArray
from locate.recording import KeyFrames

NAMED = 6
"""Most stretches of frames, or photos, that a note lists."""
BLURRED = 0.5
"""Sharpness below which a frame counts as blurred, over the median of the registered ones."""


def left_out_notes(key_frames: KeyFrames, used: IntArray, *, given: bool) -> tuple[str, ...]:
    """How many of the key frames have no pose, which these are, and why; none where all have one.

    Args:
        key_frames: The frames of the run.
        used: (N,) indices of those with a pose.
        given: The poses were given and not reconstructed.
    """
    has_pose = np.isin(key_frames.indices, used)
    rows = np.flatnonzero(~has_pose)
    if not len(rows):
        return ()
    why = _why_not_given(key_frames) if given else _why_unregistered(key_frames, has_pose)
    how_many = f"{len(rows)} of {len(key_frames)} key frames are left out"
    return (f"{how_many}, {_name_frames(key_frames, rows)}: {why}.",)


def _why_not_given(key_frames: KeyFrames) -> str:
    """Of a video, poses off its path do not count as given; their own note names them."""
    pose = "pose that lies on the path" if key_frames.is_video else "pose"
    return f"no {pose} was given for them"


def _why_unregistered(key_frames: KeyFrames, has_pose: BoolArray) -> str:
    sharpness = np.array([frame.sharpness for frame in key_frames.frames])
    least = BLURRED * float(np.median(sharpness[has_pose])) if has_pose.any() else 0.0
    blurred = int(np.count_nonzero(sharpness[~has_pose] < least))
    why = "structure from motion found too little in them that the others show"
    return f"{why}; {blurred} of them are blurred or without texture" if blurred else why


def _name_frames(key_frames: KeyFrames, rows: IntArray) -> str:
    """Photos by name, frames of a video by the times of each stretch of them."""
    frames = key_frames.frames
    if not key_frames.is_video:
        names = [frames[row].source for row in rows]
        return _join_some(names)
    stretches = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return _join_some(
        [_name_stretch(*(frames[row].time_s for row in s[[0, -1]])) for s in stretches]
    )


def _name_stretch(start_s: float, end_s: float) -> str:
    return f"at {start_s:.2f} s" if start_s == end_s else f"from {start_s:.2f} to {end_s:.2f} s"


def _join_some(names: list[str]) -> str:
    more = len(names) - NAMED
    return ", ".join(names[:NAMED]) + (f" and {more} more" if more > 0 else "")
