"""What spoils recordings: things that move, and cameras that are not what the chain takes them for.

Each nuisance turns a capture into one that has it; any of them can be combined, each at most once.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from detect.synthesis.sample import log_uniform
from locate.simulation.billboards import Billboard, lay_billboard, stand_billboard
from locate.simulation.capture import CaptureSetup
from locate.simulation.compression import compress_h264, compress_jpeg
from locate.simulation.outlines import bush_outline, patch_outline, person_outline

Nuisance = Callable[[CaptureSetup, np.random.Generator], CaptureSetup]
NUISANCE_COUNT_ODDS = (0.35, 0.35, 0.2, 0.1)
"""Odds of a capture with none, one, two and three nuisances."""


def add_people(capture: CaptureSetup, rng: np.random.Generator) -> CaptureSetup:
    """One to three people walk past, before or behind the plume."""
    billboards = []
    for _ in range(rng.integers(1, 4)):
        x, y = rng.uniform(-2.5, 2.5), rng.uniform(-4, 4)
        speed = rng.uniform(0.6, 1.8) * rng.choice([-1, 1])
        height = rng.uniform(1.5, 1.9)
        billboards.append(
            stand_billboard(
                x - 0.8 * speed,
                y,
                0.0,
                rng.uniform(-25, 25),
                size_m=(0.42 * height, height),
                photo=_draw_photo(capture, rng),
                texel_m=rng.uniform(0.002, 0.006),
                cover=person_outline(rng),
                velocity_mps=np.array([speed, rng.normal(0, 0.2), 0.0]),
                sway_m=0.015,
                sway_hz=rng.uniform(1.5, 2.2),
            )
        )
    return _add_billboards(capture, billboards)


def add_wind(capture: CaptureSetup, rng: np.random.Generator) -> CaptureSetup:
    """Bushes and trees move in the wind, and perhaps a flag."""
    billboards = []
    for _ in range(rng.integers(2, 6)):
        size = rng.uniform(0.8, 3.5, 2)
        billboards.append(
            stand_billboard(
                rng.uniform(-6, 4),
                rng.uniform(-2, 5),
                rng.uniform(-0.3, 2),
                size_m=(size[0], size[1]),
                photo=_draw_photo(capture, rng),
                texel_m=rng.uniform(0.004, 0.015),
                cover=bush_outline(rng),
                sway_m=log_uniform(rng, (0.002, 0.04)),
                sway_hz=rng.uniform(0.4, 2.0),
            )
        )
    if rng.random() < 0.5:
        flag = stand_billboard(
            rng.uniform(-4, 3),
            rng.uniform(-2, 4),
            rng.uniform(1.5, 4),
            size_m=(rng.uniform(0.6, 1.5), rng.uniform(0.4, 1.0)),
            photo=_draw_photo(capture, rng),
            texel_m=0.004,
            sway_m=rng.uniform(0.03, 0.12),
            sway_hz=rng.uniform(1, 3),
        )
        billboards.append(flag)
    return _add_billboards(capture, billboards)


def add_glints(capture: CaptureSetup, rng: np.random.Generator) -> CaptureSetup:
    """Wet patches on the ground and a shiny panel sparkle as the camera passes."""
    billboards = []
    for _ in range(rng.integers(1, 4)):
        width, depth = rng.uniform(1, 5, 2)
        at = rng.uniform(-5, 3), rng.uniform(-3, 4), rng.uniform(0.005, 0.02)
        billboards.append(_make_shiny(capture, rng, lay_billboard(*at, size_m=(width, depth))))
    if rng.random() < 0.6:
        at = rng.uniform(-4, 3), rng.uniform(1, 4.5), rng.uniform(0, 2)
        panel = stand_billboard(*at, size_m=(rng.uniform(0.5, 2), rng.uniform(0.5, 2)))
        billboards.append(_make_shiny(capture, rng, panel))
    return _add_billboards(capture, billboards)


def add_rolling_shutter(capture: CaptureSetup, rng: np.random.Generator) -> CaptureSetup:
    """The rows are read one after the other, in 8 to 30 ms."""
    return _change_shutter(capture, readout_s=float(rng.uniform(0.008, 0.03)))


def add_motion_blur(capture: CaptureSetup, rng: np.random.Generator) -> CaptureSetup:
    """Exposures of 1/125 to 1/30 s."""
    return _change_shutter(capture, exposure_s=log_uniform(rng, (1 / 125, 1 / 30)))


def add_auto_exposure(capture: CaptureSetup, rng: np.random.Generator) -> CaptureSetup:
    """The exposure drifts by some 15 %, and may jump by as much."""
    count = capture.scene.video.frames
    drift = np.cumsum(rng.normal(0, 1, count))
    drift *= rng.uniform(0.05, 0.2) / (np.ptp(drift) + 1e-6)
    jump = rng.uniform(-0.15, 0.15) * (np.arange(count) >= rng.integers(1, 2 * count))
    return _change_shutter(capture, gains=tuple(np.exp(drift - drift.mean() + jump).tolist()))


def misstate_focal(capture: CaptureSetup, rng: np.random.Generator) -> CaptureSetup:
    """The chain is given a focal length that is 1 % off."""
    return replace(capture, focal_factor=1 + 0.01 * float(rng.choice([-1, 1])))


def add_distortion(capture: CaptureSetup, rng: np.random.Generator) -> CaptureSetup:
    """The lens bends by a radial term of 0.01 to 0.04 that the chain does not know of."""
    radial = float(rng.uniform(0.01, 0.04) * rng.choice([-1, 1]))
    camera = capture.scene.camera.model_copy(update={"radial": radial})
    return replace(capture, scene=capture.scene.model_copy(update={"camera": camera}))


def store_as_jpeg(capture: CaptureSetup, rng: np.random.Generator) -> CaptureSetup:
    """Every frame is a JPEG of quality 70 to 95."""
    return replace(capture, coding=partial(compress_jpeg, quality=int(rng.integers(70, 96))))


def store_as_h264(capture: CaptureSetup, rng: np.random.Generator) -> CaptureSetup:
    """H.264 of 0.15 to 2 bits a pixel."""
    return replace(
        capture, coding=partial(compress_h264, bits_per_pixel=log_uniform(rng, (0.15, 2.0)))
    )


NUISANCES: dict[str, Nuisance] = {
    "people": add_people,
    "wind": add_wind,
    "glints": add_glints,
    "rolling_shutter": add_rolling_shutter,
    "motion_blur": add_motion_blur,
    "auto_exposure": add_auto_exposure,
    "wrong_focal": misstate_focal,
    "distortion": add_distortion,
    "jpeg": store_as_jpeg,
    "h264": store_as_h264,
}
"""By name. `compress_jpeg` and `compress_h264` exclude each other: the later one counts."""


def draw_nuisances(rng: np.random.Generator) -> tuple[str, ...]:
    """The names of a random few, mostly none or one."""
    count = int(rng.choice(len(NUISANCE_COUNT_ODDS), p=NUISANCE_COUNT_ODDS))
    return tuple(str(name) for name in rng.choice(list(NUISANCES), count, replace=False))


def apply_nuisances(
    capture: CaptureSetup, names: Sequence[str], rng: np.random.Generator
) -> CaptureSetup:
    """The capture with all the nuisances of these names.

    Args:
        capture: Its `photos` cover what moves, so it must have some for people, wind and glints.
        names: Keys of `NUISANCES`.
        rng: Draws how strong they are.
    """
    for name in names:
        capture = NUISANCES[name](capture, rng)
    return capture


def _draw_photo(capture: CaptureSetup, rng: np.random.Generator) -> int:
    return int(rng.integers(len(capture.photos)))


def _add_billboards(capture: CaptureSetup, billboards: Sequence[Billboard]) -> CaptureSetup:
    return replace(capture, billboards=(*capture.billboards, *billboards))


def _change_shutter(capture: CaptureSetup, **changes: Any) -> CaptureSetup:
    return replace(capture, shutter=replace(capture.shutter, **changes))


def _make_shiny(capture: CaptureSetup, rng: np.random.Generator, billboard: Billboard) -> Billboard:
    """The billboard with a lamp where most of the camera's path sees its reflection."""
    path = capture.scene.path
    bearing = np.radians(path.start_deg + path.arc_deg / 2)
    flat = path.radius_m * np.array([np.cos(bearing), np.sin(bearing)])
    view = billboard.corner - [path.target[0] + flat[0], path.target[1] + flat[1], path.height_m]
    view = view / np.linalg.norm(view)
    mirrored = view - 2 * (view @ billboard.normal) * billboard.normal + rng.normal(0, 0.15, 3)
    return replace(
        billboard,
        photo=_draw_photo(capture, rng),
        texel_m=rng.uniform(0.004, 0.012),
        cover=patch_outline(rng),
        gloss=log_uniform(rng, (0.2, 2.0)),
        lamp=mirrored / np.linalg.norm(mirrored),
    )
