"""What spoils recordings: things that move, and cameras that are not what the chain takes them for.

Each nuisance turns a take into one that has it; any of them can be combined, each at most once.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from detect.synthesis.sample import log_uniform
from locate.simulation.billboards import Billboard, lay_billboard, stand_billboard
from locate.simulation.capture import Take
from locate.simulation.compression import h264, jpeg
from locate.simulation.outlines import blob, bush, figure

Nuisance = Callable[[Take, np.random.Generator], Take]
HOW_MANY = (0.35, 0.35, 0.2, 0.1)
"""Odds of a take with none, one, two and three nuisances."""


def people(take: Take, rng: np.random.Generator) -> Take:
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
                photo=_any_photo(take, rng),
                texel_m=rng.uniform(0.002, 0.006),
                cover=figure(rng),
                velocity_mps=np.array([speed, rng.normal(0, 0.2), 0.0]),
                sway_m=0.015,
                sway_hz=rng.uniform(1.5, 2.2),
            )
        )
    return _add_billboards(take, billboards)


def wind(take: Take, rng: np.random.Generator) -> Take:
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
                photo=_any_photo(take, rng),
                texel_m=rng.uniform(0.004, 0.015),
                cover=bush(rng),
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
            photo=_any_photo(take, rng),
            texel_m=0.004,
            sway_m=rng.uniform(0.03, 0.12),
            sway_hz=rng.uniform(1, 3),
        )
        billboards.append(flag)
    return _add_billboards(take, billboards)


def glints(take: Take, rng: np.random.Generator) -> Take:
    """Wet patches on the ground and a shiny panel sparkle as the camera passes."""
    billboards = []
    for _ in range(rng.integers(1, 4)):
        width, depth = rng.uniform(1, 5, 2)
        at = rng.uniform(-5, 3), rng.uniform(-3, 4), rng.uniform(0.005, 0.02)
        billboards.append(_shiny(take, rng, lay_billboard(*at, size_m=(width, depth))))
    if rng.random() < 0.6:
        at = rng.uniform(-4, 3), rng.uniform(1, 4.5), rng.uniform(0, 2)
        panel = stand_billboard(*at, size_m=(rng.uniform(0.5, 2), rng.uniform(0.5, 2)))
        billboards.append(_shiny(take, rng, panel))
    return _add_billboards(take, billboards)


def rolling_shutter(take: Take, rng: np.random.Generator) -> Take:
    """The rows are read one after the other, in 8 to 30 ms."""
    return _with_shutter(take, readout_s=float(rng.uniform(0.008, 0.03)))


def motion_blur(take: Take, rng: np.random.Generator) -> Take:
    """Exposures of 1/125 to 1/30 s."""
    return _with_shutter(take, exposure_s=log_uniform(rng, (1 / 125, 1 / 30)))


def auto_exposure(take: Take, rng: np.random.Generator) -> Take:
    """The exposure drifts by some 15 %, and may jump by as much."""
    count = take.scene.video.frames
    drift = np.cumsum(rng.normal(0, 1, count))
    drift *= rng.uniform(0.05, 0.2) / (np.ptp(drift) + 1e-6)
    jump = rng.uniform(-0.15, 0.15) * (np.arange(count) >= rng.integers(1, 2 * count))
    return _with_shutter(take, gains=tuple(np.exp(drift - drift.mean() + jump).tolist()))


def wrong_focal(take: Take, rng: np.random.Generator) -> Take:
    """The chain is told of a focal length that is 1 % off."""
    return replace(take, focal_factor=1 + 0.01 * float(rng.choice([-1, 1])))


def distortion(take: Take, rng: np.random.Generator) -> Take:
    """The lens bends by a radial term of 0.01 to 0.04 that the chain is not told of."""
    radial = float(rng.uniform(0.01, 0.04) * rng.choice([-1, 1]))
    camera = take.scene.camera.model_copy(update={"radial": radial})
    return replace(take, scene=take.scene.model_copy(update={"camera": camera}))


def jpeg_frames(take: Take, rng: np.random.Generator) -> Take:
    """Every frame is a JPEG of quality 70 to 95."""
    return replace(take, coding=partial(jpeg, quality=int(rng.integers(70, 96))))


def video(take: Take, rng: np.random.Generator) -> Take:
    """H.264 of 0.15 to 2 bits a pixel."""
    return replace(take, coding=partial(h264, bits_per_pixel=log_uniform(rng, (0.15, 2.0))))


NUISANCES: dict[str, Nuisance] = {
    "people": people,
    "wind": wind,
    "glints": glints,
    "rolling_shutter": rolling_shutter,
    "motion_blur": motion_blur,
    "auto_exposure": auto_exposure,
    "wrong_focal": wrong_focal,
    "distortion": distortion,
    "jpeg": jpeg_frames,
    "h264": video,
}
"""By name. `jpeg` and `h264` exclude each other: the later one counts."""


def some_nuisances(rng: np.random.Generator) -> tuple[str, ...]:
    """The names of a random few, mostly none or one."""
    count = int(rng.choice(len(HOW_MANY), p=HOW_MANY))
    return tuple(str(name) for name in rng.choice(list(NUISANCES), count, replace=False))


def spoiled(take: Take, names: Sequence[str], rng: np.random.Generator) -> Take:
    """The take with all the nuisances of these names.

    Args:
        take: Its `photos` cover what moves, so it must have some for people, wind and glints.
        names: Keys of `NUISANCES`.
        rng: Draws how strong they are.
    """
    for name in names:
        take = NUISANCES[name](take, rng)
    return take


def _any_photo(take: Take, rng: np.random.Generator) -> int:
    return int(rng.integers(len(take.photos)))


def _add_billboards(take: Take, billboards: Sequence[Billboard]) -> Take:
    return replace(take, billboards=(*take.billboards, *billboards))


def _with_shutter(take: Take, **changes: Any) -> Take:
    return replace(take, shutter=replace(take.shutter, **changes))


def _shiny(take: Take, rng: np.random.Generator, billboard: Billboard) -> Billboard:
    """The billboard with a lamp where most of the camera's path sees its reflection."""
    path = take.scene.path
    bearing = np.radians(path.start_deg + path.arc_deg / 2)
    flat = path.radius_m * np.array([np.cos(bearing), np.sin(bearing)])
    view = billboard.corner - [path.target[0] + flat[0], path.target[1] + flat[1], path.height_m]
    view = view / np.linalg.norm(view)
    mirrored = view - 2 * (view @ billboard.normal) * billboard.normal + rng.normal(0, 0.15, 3)
    return replace(
        billboard,
        photo=_any_photo(take, rng),
        texel_m=rng.uniform(0.004, 0.012),
        cover=blob(rng),
        gloss=log_uniform(rng, (0.2, 2.0)),
        lamp=mirrored / np.linalg.norm(mirrored),
    )
