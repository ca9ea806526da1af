"""What the reader of a map must know, one sentence each."""

from collections.abc import Sequence

from detect.detection import Detection
from detect.registry import DetectorChoice
from geometry.covariance import sigma_along
from geometry.trajectory import Trajectory
from locate.fusion.find import FoundPlumes
from locate.fusion.limit import AMPLITUDES_PX
from locate.map.answer import Cause, Obstacle
from locate.map.plume import Plume
from locate.recording import KeyFrames

ONE_VIEWPOINT = (
    "The camera stood still: one viewpoint gives directions to plumes, not positions, and what "
    "moves by itself (leaves, people) may pass for one. Move the camera around for a 3D map."
)
FREE_SCALE = "The scale is free: lengths are in scene units, not metres."
BLIND = (
    f"Even a plume of {AMPLITUDES_PX[-1]:.0f} px would have been missed in half of the places: "
    "others may be there."
)
UNCONFIRMED = (
    "Left out: {count} that pixels alone would call a plume, but about which the displacement does "
    "not turn as about one. Hard compression and things that move make such."
)
MORE_FRAMES = (
    "The displacement alone of {more} more frames counts beside {measured} measured whole."
)


def map_notes(
    measured: Sequence[Detection],
    detector: DetectorChoice,
    trajectory: Trajectory,
    found: FoundPlumes,
    obstacles: Sequence[Obstacle] = (),
    *,
    more: int = 0,
) -> tuple[str, ...]:
    """The notes on a map of a moving camera.

    Args:
        measured: The detections it was fused from.
        detector: That made them.
        trajectory: Of the camera.
        found: What they show.
        obstacles: What kept the run from judging; the map states them too.
        more: Frames of which the displacement alone was measured.
    """
    counted = any(obstacle.cause is Cause.SILENT_FRAMES for obstacle in obstacles)
    notes = empty_frames_notes(measured, detector, with_count=not counted)
    if more:
        notes.append(MORE_FRAMES.format(measured=len(measured), more=more))
    if not trajectory.metric:
        notes.append(FREE_SCALE)
    if found.limit_px is None and found.plumes:
        notes.append(BLIND)
    if found.unconfirmed:
        notes.append(UNCONFIRMED.format(count=found.unconfirmed))
    unit_name = "m" if trajectory.metric else "scene units"
    notes += [hidden_note(plume, unit_name) for plume in found.plumes if plume.source_hidden]
    return tuple(notes)


def full_size_notes(key_frames: KeyFrames) -> tuple[str, ...]:
    """At which size what was measured, where that is not one size."""
    full = key_frames.full_size
    if full is None:
        return ()
    return (
        f"Poses and the evidence of single pixels are of frames of {key_frames.width}x"
        f"{key_frames.height} px, what all pixels tell together of {full[0]}x{full[1]} px.",
    )


def empty_frames_notes(
    found: Sequence[Detection], detector: DetectorChoice, *, with_count: bool = True
) -> list[str]:
    """How many of the frames hold no evidence, where the detector has a note on that.

    Args:
        found: The detections.
        detector: That made them.
        with_count: Say how many; otherwise only what else to try.
    """
    empty = sum(not each.llr.any() for each in found)
    note = detector.empty_frames_note(empty, len(found), with_count=with_count)
    return [] if note is None else [note]


def hidden_note(plume: Plume, unit_name: str) -> str:
    """Where along its axis a hidden source may be, from 2 sigma below to where evidence begins."""
    below = 2 * sigma_along(plume.source_covariance, plume.axis)
    above = max(0.0, min(plume.extent_low, below))
    return (
        f"Something stands before the source of plume {plume.id}: along the axis it lies between "
        f"{below:.2g} {unit_name} below and {above:.2g} {unit_name} above the stated point."
    )
