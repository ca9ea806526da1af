"""A recording watched once: its shots, which frames show something, and whether it moves."""

from dataclasses import dataclass

import numpy as np

from geometry.arrays import GreyImage
from geometry.errors import BadInputError
from geometry.reports import Report
from locate.recording.frame_memory import FrameMemory
from locate.recording.index import KeyFrame
from locate.recording.motion import (
    LEAST_TEXTURE,
    StillnessTest,
    make_thumbnail,
    measure_sharpness,
    measure_texture,
    median_motion,
)
from locate.recording.recording import Recording, every_frame
from locate.recording.sampling import LookedAt
from locate.recording.shots import Continuity, CutFinder
from locate.recording.spacing import Candidate, FrameSpacer

THUMBNAIL_SIDE = 320
"""Longest side of the images whose motion is measured, px."""
FAINT = 0.12
"""Texture below which a frame shows nothing, over the median of the shot."""
GOOD_TEXTURE = 3.0
"""Texture from which on a first frame is compared with the others; usual ones have 6 to 14,
grey levels a px."""
BRIGHTENING, FADE_IN_S = 2.0, 2.0
"""Factor of texture at which a weak first frame gives way to a later one, and how much later."""
APPEARING = 8.0
"""The same however much later: the first frames showed only grain."""
MOST_WAITING = 32
"""Most frames in memory while it is not known whether they are a new shot."""
NAMED_SHOTS = 8
"""Most shots whose times a note states."""


@dataclass(frozen=True, kw_only=True)
class _WatchedFrame:
    candidate: Candidate
    image: GreyImage
    texture: float


@dataclass(frozen=True, kw_only=True)
class WatchedShot:
    """What is known of the shot that is used.

    Attributes:
        frames: All of its frames that were looked at and show something.
        spaced: Those of them that are even in image motion.
        still: The camera did not move.
        notes: What of the recording is left out.
        memory: The frames themselves, where the recording is short.
    """

    frames: list[KeyFrame]
    spaced: list[KeyFrame]
    still: bool
    notes: tuple[str, ...]
    memory: FrameMemory


class _Shot:
    """Frames without a cut between them."""

    def __init__(self, target_motion: float, *, is_video: bool) -> None:
        self.frames: list[KeyFrame] = []
        self._target_motion = target_motion
        self._is_video = is_video
        self._textures: list[float] = []
        self._start = 0
        self._spacer: FrameSpacer | None = None
        self._stillness: StillnessTest | None = None

    def add(self, seen: _WatchedFrame) -> None:
        self.frames.append(seen.candidate.frame)
        self._textures.append(seen.texture)
        if seen.texture < LEAST_TEXTURE:
            return
        if self._spacer is None or self._stillness is None or self._shows_more(seen):
            self._start = len(self.frames) - 1
            target_px = self._target_motion * seen.candidate.thumb.shape[1]
            self._spacer = FrameSpacer(seen.candidate, target_px)
            self._stillness = StillnessTest(seen.image)
        else:
            self._spacer.add(seen.candidate)
            self._stillness.add(seen.image)

    @property
    def is_still(self) -> bool:
        """Whether the camera did not move so far."""
        return self._stillness is not None and self._stillness.is_still

    def finish(self) -> tuple[list[KeyFrame], list[KeyFrame], bool]:
        """The frames that show something, the spaced of them, and whether the camera is still."""
        textures = np.array(self._textures)
        visible = textures >= LEAST_TEXTURE
        if not visible.any() or self._spacer is None:
            return [], [], False
        visible &= textures >= FAINT * np.median(textures[visible])
        visible[: self._start] = False
        kept = [frame for frame, shows in zip(self.frames, visible, strict=True) if shows]
        indices = {frame.index for frame in kept}
        spaced = [frame for frame in self._spacer.finish() if frame.index in indices]
        return kept, spaced, self.is_still

    def _shows_more(self, seen: _WatchedFrame) -> bool:
        """The shot so far was faint in comparison: it begins anew."""
        first = self._textures[self._start]
        if first >= GOOD_TEXTURE:
            return False
        waited_s = seen.candidate.frame.time_s - self.frames[self._start].time_s
        fades_in = self._is_video and waited_s <= FADE_IN_S
        return seen.texture >= (BRIGHTENING if fades_in else APPEARING) * first


def watch_recording(
    recording: Recording,
    target_motion: float,
    max_frames: int,
    progress: Report | None,
    *,
    shot: int | None = None,
) -> WatchedShot:
    """Looks at the frames, tells the shots of a video apart, and describes the longest or the one.

    Of a long video not every frame is looked at, see `LookedAt`.

    Args:
        recording: What `open_recording` gave.
        target_motion: Median image motion wanted between neighbours, as a share of the width.
        max_frames: The most key frames that are wanted.
        progress: Called with a stage name and half the fraction read; -1 where that is unknown.
        shot: The one to describe, from 1; None for the longest.

    Raises:
        BadInputError: Fewer than two frames, or fewer than two that show anything; no such shot.
    """
    memory = FrameMemory()
    shots = _watch_shots(recording, target_motion, max_frames, memory, progress)
    count = sum(len(shot.frames) for shot in shots)
    if count < 2:
        known = "".join(f"; {note}" for note in recording.warnings)
        raise BadInputError(f"{recording.path}: only {count} frame; at least 2 are needed{known}")
    if shot is not None and not 1 <= shot <= len(shots):
        raise BadInputError(
            f"{recording.path}: has no shot {shot}, only 1 to {len(shots)}: {_list_spans(shots)}"
        )
    used = max(shots, key=lambda one: len(one.frames)) if shot is None else shots[shot - 1]
    frames, spaced, still = used.finish()
    if len(frames) < 2:
        raise BadInputError(
            f"{recording.path}: {len(frames)} of {len(used.frames)} frames show anything, the "
            "others are black, white, faded or blurred; at least 2 are needed, record with more "
            "light and in focus"
        )
    notes = (
        *_shots_note(shots, used, chosen=shot is not None),
        *_faint_note(recording, used.frames, frames),
    )
    return WatchedShot(frames=frames, spaced=spaced, still=still, notes=notes, memory=memory)


def _watch_shots(
    recording: Recording,
    target_motion: float,
    max_frames: int,
    memory: FrameMemory,
    progress: Report | None,
) -> list[_Shot]:
    shots = [_Shot(target_motion, is_video=recording.is_video)]
    cuts = CutFinder()
    waiting: list[_WatchedFrame] = []
    previous: GreyImage | None = None
    before = -1
    scale = max(1.0, max(recording.width, recording.height) / THUMBNAIL_SIDE)

    def assign(verdict: Continuity) -> None:
        if verdict is Continuity.UNSURE:
            return
        if verdict is Continuity.CUT:
            shots.append(_Shot(target_motion, is_video=recording.is_video))
        for each in waiting:
            shots[-1].add(each)
        waiting.clear()

    looked_at = LookedAt(recording.expected_frames, max_frames, lambda: shots[-1].is_still)
    is_wanted = looked_at if recording.is_video else every_frame
    for count, frame in enumerate(recording.frames(is_wanted), start=1):
        memory.add(frame)
        thumb = make_thumbnail(frame.image, THUMBNAIL_SIDE)
        texture = measure_texture(thumb)
        step_px = 0.0 if previous is None else median_motion(previous, thumb)
        key = KeyFrame(
            index=frame.index,
            time_s=frame.time_s,
            source=frame.source,
            sharpness=measure_sharpness(frame.image),
            motion_px=step_px * scale,
            is_b_frame=frame.is_b_frame,
        )
        candidate = Candidate(frame=key, thumb=thumb, before=before, step_px=step_px)
        waiting.append(_WatchedFrame(candidate=candidate, image=frame.image, texture=texture))
        if recording.is_video and texture >= LEAST_TEXTURE:
            assign(cuts.add(thumb))
        elif len(waiting) == 1:
            assign(Continuity.SAME)
        elif len(waiting) > MOST_WAITING:
            assign(cuts.finish())
        previous, before = thumb, frame.index
        if progress:
            total = recording.expected_frames
            read = frame.index + 1 if recording.is_video else count
            progress("watching the recording", 0.5 * min(1.0, read / total) if total else -1.0)
    assign(cuts.finish())
    return shots


def _shots_note(shots: list[_Shot], used: _Shot, *, chosen: bool) -> tuple[str, ...]:
    if len(shots) == 1:
        return ()
    others = sum(len(shot.frames) for shot in shots) - len(used.frames)
    which = f"number {shots.index(used) + 1}" if chosen else "the longest"
    return (
        f"The video has {len(shots)} shots, {_list_spans(shots)}: {which}, {_span(used)}, is used, "
        f"and {others} frames of the others are left out; --shot NUMBER chooses one, from 1.",
    )


def _list_spans(shots: list[_Shot]) -> str:
    more = len(shots) - NAMED_SHOTS
    listed = ", ".join(map(_span, shots[:NAMED_SHOTS]))
    return listed + (f" and {more} more" if more > 0 else "")


def _span(shot: _Shot) -> str:
    return f"{shot.frames[0].time_s:.2f} to {shot.frames[-1].time_s:.2f} s"


def _faint_note(
    recording: Recording, every: list[KeyFrame], kept: list[KeyFrame]
) -> tuple[str, ...]:
    used = {frame.index for frame in kept}
    faint = [frame for frame in every if frame.index not in used]
    if not faint:
        return ()
    if recording.is_video:
        where = f"between {faint[0].time_s:.2f} and {faint[-1].time_s:.2f} s"
    else:
        where = faint[0].source + (f" to {faint[-1].source}" if len(faint) > 1 else "")
    return (
        f"{len(faint)} of {len(every)} frames are left out because they show too little: black, "
        f"white, faded or blurred, {where}.",
    )
