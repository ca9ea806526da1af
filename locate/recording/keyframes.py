"""Key frames: even in image motion, sharp, bounded in number."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from geometry.arrays import FloatArray, GreyImage, IntArray
from geometry.disk_space import check_space
from geometry.reports import Report
from locate.recording.images import write_png
from locate.recording.index import FULL_SIZE, KeyFrame, KeyFrames
from locate.recording.motion import make_thumbnail, median_motion
from locate.recording.recording import Frame, Recording
from locate.recording.spacing import avoid_b_frames
from locate.recording.watching import THUMBNAIL_SIDE, watch_recording

TARGET_MOTION = 0.005
"""Image motion wanted between key frames, over the width."""
MIN_KEY_FRAMES = 8
"""Fewest frames spaced by motion; with less, frames are spread over the whole path."""
CLOSELY_S, ROW_SPACING_S = 0.12, 1 / 15
"""Of a camera at rest: spacing in time beyond which half the frames are taken in a row, and
their spacing there."""


def select_frames(
    recording: Recording,
    folder: Path,
    *,
    max_frames: int = 120,
    target_motion: float = TARGET_MOTION,
    at_rest: bool = False,
    shot: int | None = None,
    progress: Report | None = None,
) -> KeyFrames:
    """Chooses key frames and writes them as grey PNG files ``folder/{index:06d}.png``.

    Of a moving camera, what the recording holds beyond the working size goes to `FULL_SIZE`.

    A video is thinned to `target_motion` between neighbours, B frames are taken last, photos all
    kept; beyond `max_frames` the kept ones are spread evenly over the path of the image motion. A
    recording by a camera at rest keeps frames evenly in time; where these would be more than
    `CLOSELY_S` apart, half of them come from the middle of the video, one close after the other.
    Of several shots the longest is used; frames without texture are left out; the warnings say so.

    Args:
        recording: What `open_recording` gave.
        folder: Where to write; made where it is missing.
        max_frames: The most frames to keep.
        target_motion: Median image motion wanted between neighbours, as a share of the width.
        at_rest: The camera is known to have been at rest, however the image moves.
        shot: Of a video, the one to use, from 1; None for the longest.
        progress: Called with a stage name and the fraction of the whole call, which never falls:
            measuring motion is the first half, writing the second; -1 while measuring where the
            length is unknown.

    Returns:
        The index of the written files, with the motion between neighbours measured anew.

    Raises:
        BadInputError: Fewer than two frames that show anything, or frames that cannot be used.
    """
    watched = watch_recording(recording, target_motion, max_frames, progress, shot=shot)
    every, spaced, still = watched.frames, watched.spaced, at_rest or watched.still
    if still:
        wanted = every
        chosen = _at_rest(every, max_frames, in_time=recording.is_video)
    else:
        by_motion = recording.is_video and len(spaced) >= MIN_KEY_FRAMES
        wanted = spaced if by_motion else every
        motions = [1.0 if by_motion else frame.motion_px for frame in wanted]
        rows = _spread_along(np.cumsum(motions), max_frames)
        rows = avoid_b_frames(rows, np.array([frame.is_b_frame for frame in wanted]))
        chosen = [wanted[row] for row in rows]
    thinned = _note_thinned(recording, len(wanted), len(chosen), still=still)
    full = recording.sizes.has_full_size and not still
    frames = watched.memory.find(chosen) or recording.frames_again(chosen)
    kept = _write_frames(recording, chosen, frames, folder, progress, full=full)
    return KeyFrames(
        frames=tuple(kept),
        width=recording.width,
        height=recording.height,
        is_video=recording.is_video,
        static=still,
        focal_prior_px=recording.focal_prior_px,
        focal_source=recording.focal.source if recording.focal else None,
        bits_per_pixel=recording.bits_per_pixel,
        codec=None if recording.coding is None else recording.coding.codec,
        full_width=recording.sizes.full[0] if full else None,
        full_height=recording.sizes.full[1] if full else None,
        warnings=(*recording.warnings, *watched.notes, *thinned),
    )


def _note_thinned(recording: Recording, wanted: int, chosen: int, *, still: bool) -> list[str]:
    """What the most frames leave out of a recording."""
    if chosen == wanted:
        return []
    if still and recording.is_video:
        return [
            f"{recording.path.name}: {chosen} of {wanted} frames by a camera at rest are used; a "
            "larger --max-frames uses more"
        ]
    what = "frames that its motion asks for" if recording.is_video else "photos"
    return [
        f"{recording.path.name}: {chosen} of {wanted} {what} are used, spread evenly; "
        f"--max-frames {wanted} uses all"
    ]


def _spread_along(path: FloatArray | IntArray, count: int) -> IntArray:
    """At most `count` of the frames, evenly along `path`, a length that never falls."""
    if len(path) <= count:
        return np.arange(len(path))
    path = path + 1e-6 * np.arange(len(path))  # strictly rising, also where nothing moves
    wanted = np.linspace(path[0], path[-1], count)
    return np.unique(np.searchsorted(path, wanted))


def _at_rest(frames: list[KeyFrame], count: int, *, in_time: bool) -> list[KeyFrame]:
    """At most `count` frames, evenly; in a video of more, half of them in a row if need be."""
    indices = np.array([frame.index for frame in frames], dtype=np.int64)
    evenly = [frames[row] for row in _spread_along(indices, count)]
    if not in_time or np.median(np.diff([frame.time_s for frame in evenly])) <= CLOSELY_S:
        return evenly
    middle = len(frames) // 2
    close = frames[max(0, middle - count) : middle + count]
    spacing_s = float(np.median(np.diff([frame.time_s for frame in close])))
    step = max(1, round(ROW_SPACING_S / max(spacing_s, 1e-3)))
    start = max(0, (len(frames) - count // 2 * step) // 2)
    row = frames[start::step][: count // 2]
    others = [frame for frame in evenly if frame not in row]
    spread = _spread_along(np.arange(len(others)), count - len(row))
    return sorted((*row, *(others[k] for k in spread)), key=lambda frame: frame.index)


def _write_frames(
    recording: Recording,
    chosen: list[KeyFrame],
    frames: Iterable[Frame],
    folder: Path,
    progress: Report | None,
    *,
    full: bool,
) -> list[KeyFrame]:
    folder.mkdir(parents=True, exist_ok=True)
    if full:
        (folder / FULL_SIZE).mkdir(exist_ok=True)
        check_space(folder, len(chosen) * recording.sizes.full_size_bytes)
    wanted = {frame.index: frame for frame in chosen}
    written: list[KeyFrame] = []
    previous: GreyImage | None = None
    scale = max(1.0, max(recording.width, recording.height) / THUMBNAIL_SIDE)
    for frame in frames:
        key = wanted[frame.index]
        _, encoded = cv2.imencode(".png", frame.image)
        (folder / key.name).write_bytes(encoded.tobytes())
        if full:
            write_png(folder / FULL_SIZE / key.name, recording.full_size(frame))
        thumb = make_thumbnail(frame.image, THUMBNAIL_SIDE)
        motion_px = 0.0
        if previous is not None:
            # The motion since the frame just before is known.
            is_next = key.index == written[-1].index + 1
            motion_px = key.motion_px if is_next else median_motion(previous, thumb) * scale
        written.append(replace(key, motion_px=motion_px))
        previous = thumb
        if progress:
            progress("writing key frames", 0.5 + 0.5 * len(written) / len(chosen))
    return written
