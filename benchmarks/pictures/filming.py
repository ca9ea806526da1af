"""One leak filmed well and in five ways that hide it: what the registered detector sees.

    python -m benchmarks.pictures filming -o docs/images/filming.jpg

Each is 24 frames of 320x240 on an arc of 40 degrees around the pipe rack of
`examples/scenes/pipe_rack_leak.yaml`, with true poses. The evidence of the middle frame is laid
over it; the numbers are the share of the leak's pixels (above 0.3 px, of 1 px at its 95th
percentile in the first) and of all others that have more than 1 nat.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common.plots import blank, text
from detect.detection import Frames
from detect.evidence import LLR_MAX
from detect.registry import make_detector
from geometry.image_files import write_image
from geometry.refraction import lever_px
from locate.export.pictures import overlay_evidence
from locate.simulation import Scene
from locate.simulation.capture import CaptureSetup, render_frames
from locate.simulation.compression import compress_h264
from locate.simulation.scene import WallObject
from locate.simulation.shutter import Shutter

SCENE = Path("examples/scenes/pipe_rack_leak.yaml")
RANGE_M, FAR_WALL_M, NEAR_WALL_M = 8.5, 7.0, 1.4
"""From the camera to the leak, and from the leak to the walls behind it."""
SEEN_NATS = 1.0
LEAST_PX = 0.3
LABEL_PX = 34


@dataclass(frozen=True)
class Shown:
    """One way of filming: its picture, and the shares of pixels with evidence."""

    picture: np.ndarray
    inside: float
    outside: float


def plant() -> CaptureSetup:
    scene = Scene.load(SCENE)
    changes = {
        "camera": scene.camera.model_copy(update={"width": 320, "height": 240, "focal_px": 280.0}),
        "video": scene.video.model_copy(update={"frames": 24}),
        "path": scene.path.model_copy(update={"arc_deg": 40.0, "start_deg": -110.0}),
    }
    return CaptureSetup(scene=scene.model_copy(update=changes))


def before_sky(capture: CaptureSetup) -> CaptureSetup:
    kept = [one for one in capture.scene.objects if one.kind not in {"wall", "tank", "cylinder"}]
    return replace(capture, scene=capture.scene.model_copy(update={"objects": tuple(kept)}))


def before_near_wall(capture: CaptureSetup) -> CaptureSetup:
    """The same leak, and so a smaller displacement: by the lever alone."""
    start, end = (-13.0, NEAR_WALL_M), (13.0, NEAR_WALL_M)
    wall = WallObject(kind="wall", start=start, end=end, height_m=9.0, material="brick")
    scene = capture.scene
    near, far = (
        lever_px(range_to_plume_m=RANGE_M, range_to_background_m=RANGE_M + metres, focal_px=1.0)
        for metres in (NEAR_WALL_M, FAR_WALL_M)
    )
    plume = scene.plumes[0].model_copy(update={"amplitude_px": near / far})
    changes = {"objects": (*scene.objects, wall), "plumes": (plume,)}
    return replace(capture, scene=scene.model_copy(update=changes))


def in_dim_light(capture: CaptureSetup) -> CaptureSetup:
    image = capture.scene.image.model_copy(update={"noise": 8.0})
    return replace(capture, scene=capture.scene.model_copy(update={"image": image}))


WAYS: dict[str, Callable[[CaptureSetup], CaptureSetup]] = {
    "as it should be": lambda capture: capture,
    "before the sky": before_sky,
    "a wall 1.4 m behind it": before_near_wall,
    "exposures of 1/15 s": lambda capture: replace(capture, shutter=Shutter(exposure_s=1 / 15)),
    "H.264, 0.05 bits a pixel": lambda capture: replace(
        capture, coding=partial(compress_h264, bits_per_pixel=0.05)
    ),
    "dim light, noise 8 of 255": in_dim_light,
}


def show(capture: CaptureSetup) -> Shown:
    frames = render_frames(capture)
    middle = len(frames.images) // 2
    seen = make_detector("registered").detect(
        Frames(images=frames.images, trajectory=frames.trajectory, b_frames=frames.b_frames), middle
    )
    truth = frames.truths[middle]
    size = np.linalg.norm(truth.displacement, axis=-1)
    leak = size > LEAST_PX * frames.amplitude_px
    evident = seen.llr > SEEN_NATS
    return Shown(
        overlay_evidence(frames.images[middle], seen.llr, LLR_MAX),
        float(evident[leak].mean()) if leak.any() else 0.0,
        float(evident[~leak].mean()),
    )


def panel(name: str, shown: Shown) -> np.ndarray:
    label = blank(LABEL_PX, shown.picture.shape[1])
    text(label, name, (4, 14))
    text(label, f"leak {shown.inside:.0%}, elsewhere {shown.outside:.1%}", (4, 29))
    return np.vstack([shown.picture, label])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", type=Path, default=Path("work/filming.jpg"))


def main(options: argparse.Namespace) -> None:
    panels = []
    for name, change in WAYS.items():
        shown = show(change(plant()))
        print(f"{name:26} leak {shown.inside:.2f}  elsewhere {shown.outside:.3f}", flush=True)
        panels.append(panel(name, shown))
    rows = [np.hstack(panels[first : first + 2]) for first in range(0, len(panels), 2)]
    picture = np.vstack(rows)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    write_image(options.output, picture, [cv2.IMWRITE_JPEG_QUALITY, 85])
