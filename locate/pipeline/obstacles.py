"""What keeps a run from judging, why, and what to film instead."""

from collections.abc import Sequence

import numpy as np

from detect.detection import Detection
from locate.fusion.limit import AMPLITUDES_PX
from locate.map.answer import Cause, Obstacle
from locate.recording import KeyFrames

FEWEST_FRAMES = 12
"""Of a moving camera: eight neighbours to compare a frame with, and some at each end that have
them on one side only; chosen by hand."""
MOST_MOTION = 0.08
"""Median image motion between neighbours, over the width, from which on fewer than eight others
share half of a frame with it on both sides; chosen by hand."""
FINE_CODING = 0.3
"""Bits for each pixel that is used, below which video loses the displacement of weak plumes: at
0.18 one of 0.11 px was missed where 0.09 px was the stated limit."""
MOST_UNJUDGED = 0.5
"""Share of frames or pixels without evidence that is worth a word; chosen by hand."""


def foreseen_obstacles(key_frames: KeyFrames) -> tuple[Obstacle, ...]:
    """What the frames themselves show, before anything is measured in them."""
    found = []
    count = len(key_frames)
    if not key_frames.static and count < FEWEST_FRAMES:
        found.append(
            Obstacle(
                cause=Cause.FEW_FRAMES,
                why=f"Only {count} frames can be used.",
                remedy="Film at least 60 frames, or take as many photos, on an arc of 45 degrees "
                "or more around the scene.",
            )
        )
    motions = [frame.motion_px for frame in key_frames.frames[1:]]
    motion = float(np.median(motions)) / key_frames.width if motions else 0.0
    if not key_frames.static and motion > MOST_MOTION:
        found.append(
            Obstacle(
                cause=Cause.LITTLE_OVERLAP,
                why=f"From one frame to the next the image moves by {motion:.0%} of its width: "
                "too few frames show the same part of the scene.",
                remedy="Move more slowly, film at more frames a second, or raise --max-frames if "
                f"it leaves frames out: below {MOST_MOTION:.0%} of the width from one frame to the "
                "next.",
            )
        )
    bits = key_frames.bits_per_pixel
    if bits is not None and bits < FINE_CODING:
        found.append(
            Obstacle(
                cause=Cause.COARSE_CODING,
                why=f"The video is coded ({key_frames.codec}) with {bits:.2g} bits a pixel of "
                f"{key_frames.width}x{key_frames.height}: small displacements are lost.",
                remedy=f"Film at the highest bit rate, {FINE_CODING:g} bits a pixel or more, or "
                "take photos; give the camera's own file, not one that a program sent on.",
            )
        )
    return tuple(found)


def measured_obstacles(found: Sequence[Detection], *, depth: bool) -> tuple[Obstacle, ...]:
    """What the detections of a map show that would have missed any plume; one at least.

    Args:
        found: The detections.
        depth: Whether any of them measures how far the background is, where that is needed.
    """
    shares = [float((each.llr != 0).mean()) for each in found]
    with_evidence = [share for share in shares if share]
    empty = len(shares) - len(with_evidence)
    obstacles = []
    if not depth:
        obstacles.append(
            Obstacle(
                cause=Cause.NO_PARALLAX,
                why="No frame shows how far away its background is.",
                remedy="Walk around the scene; do not only turn the camera.",
            )
        )
    if empty > MOST_UNJUDGED * len(shares):
        obstacles.append(
            Obstacle(
                cause=Cause.SILENT_FRAMES,
                why=f"{empty} of {len(shares)} measured frames hold no evidence: the others could "
                "not be registered to them well enough.",
                remedy="Move slowly around a scene in which nothing else moves, with focus and "
                "exposure locked.",
            )
        )
    if with_evidence and np.mean(with_evidence) < 1 - MOST_UNJUDGED:
        obstacles.append(
            Obstacle(
                cause=Cause.UNJUDGED_PIXELS,
                why=f"Only {np.mean(with_evidence):.0%} of the pixels can be judged.",
                remedy="Film before a background full of fine detail, such as brick, gravel or a "
                "printed pattern, in focus and in good light.",
            )
        )
    if not obstacles:
        obstacles.append(
            Obstacle(
                cause=Cause.NOISE,
                why="What was measured is too noisy: even a plume of "
                f"{AMPLITUDES_PX[-1]:.0f} px would have been missed in half of the places.",
                remedy="Film in good light, with a short exposure and focus locked, and give the "
                "focal length or the poses if they are known.",
            )
        )
    return tuple(obstacles)
