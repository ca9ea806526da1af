"""Plants drawn at random, for benchmarks."""

import numpy as np

from locate.simulation.scene import (
    BoxObject,
    CylinderObject,
    GroundObject,
    ImageBlock,
    PathBlock,
    PipeRackObject,
    PlanarPoint,
    PlumeSpec,
    Point,
    Scene,
    SceneObject,
    TankObject,
    VideoBlock,
    WallObject,
)

WALL_MATERIALS = ("brick", "concrete", "block", "cladding")
CRATE_MATERIALS = ("planks", "steel", "concrete", "plate", "cladding")
YARD_M = 3.0
"""Around the origin, where the leak is: kept clear of tall things."""


def random_scene(
    seed: int,
    *,
    plume: bool,
    amplitude_px: float = 1.0,
    noise: float = 1.0,
    frames: int = 60,
    arc_deg: float = 60.0,
) -> Scene:
    """A plant with walls, tanks, racks, crates and poles, filmed on an orbit.

    Args:
        seed: Fixes the layout, the textures, the flow and the noise.
        plume: Put a hot-gas leak in it. The rest of the scene is the same either way.
        amplitude_px: Strength of the plume, 95th percentile of |w|.
        noise: Sensor noise in 1/255.
        frames: Length of the recording.
        arc_deg: Length of the orbit.
    """
    rng = np.random.default_rng([seed, 11])
    source, yard = _draw_leak(rng)
    radius_m = rng.uniform(7.0, 10.0)
    path = PathBlock(
        kind="orbit",
        target=(source[0], source[1], source[2] + float(rng.uniform(0.3, 0.9))),
        radius_m=radius_m,
        height_m=rng.uniform(1.2, 2.6),
        start_deg=-90 - arc_deg / 2 + rng.uniform(-8, 8),
        arc_deg=arc_deg,
        jitter_m=0.015,
        jitter_deg=0.1,
    )
    ground = GroundObject(
        kind="ground", material=str(rng.choice(["gravel", "asphalt", "concrete"]))
    )
    objects = [
        ground,
        *_draw_walls(rng),
        *yard,
        *_draw_tanks(rng),
        *_draw_crates(rng),
        *_draw_poles(rng),
    ]
    leak = PlumeSpec(
        source=source,
        radius_m=rng.uniform(0.1, 0.17),
        height_m=rng.uniform(3.0, 4.0),
        temperature_k=rng.uniform(360, 500),
        amplitude_px=amplitude_px,
    )
    wind = rng.normal(0, 0.08, 2)
    return Scene(
        seed=seed,
        video=VideoBlock(frames=frames),
        image=ImageBlock(noise=noise, gain=rng.uniform(0.85, 1.15)),
        path=path,
        sun_deg=(rng.uniform(-150, -30), rng.uniform(30, 60)),
        wind_mps=(float(wind[0]), float(wind[1])),
        objects=tuple(objects),
        plumes=(leak,) if plume else (),
    )


def _draw_leak(rng: np.random.Generator) -> tuple[Point, list[SceneObject]]:
    """The exit of the leak near the origin, and its support."""
    x, y = rng.uniform(-0.6, 0.6, 2)
    below: list[SceneObject]
    match rng.integers(3):
        case 0:
            levels = (float(rng.uniform(1.0, 1.4)), float(rng.uniform(1.7, 2.2)))
            rack = PipeRackObject(
                kind="pipe_rack",
                center=(x, y + 0.5),
                length_m=rng.uniform(5, 9),
                width_m=1.4,
                levels_m=levels,
                yaw_deg=rng.uniform(-12, 12),
            )
            foot, below = levels[1], [rack]
        case 1:
            height = float(rng.uniform(0.9, 1.6))
            size = (float(rng.uniform(0.8, 1.6)), float(rng.uniform(0.8, 1.2)), height)
            below = [
                BoxObject(
                    kind="box",
                    center=(x, y, height / 2),
                    size=size,
                    yaw_deg=rng.uniform(0, 90),
                    material=str(rng.choice(CRATE_MATERIALS)),
                )
            ]
            foot = height
        case _:
            height = float(rng.uniform(0.8, 1.4))
            below = [
                TankObject(
                    kind="tank", center=(x, y), radius_m=rng.uniform(0.5, 0.8), height_m=height
                )
            ]
            foot = height
    top = foot + float(rng.uniform(0.15, 0.35))
    nozzle = CylinderObject(
        kind="cylinder", start=(x, y, foot - 0.02), end=(x, y, top), radius_m=0.1, material="steel"
    )
    return (x, y, top), [*below, nozzle]


def _draw_walls(rng: np.random.Generator) -> list[SceneObject]:
    """A broken front behind the yard, and a wing on either side."""
    split = rng.uniform(-4, 4)
    back = rng.uniform(5.0, 8.0, 4)
    left, right = rng.uniform(11, 15, 2)
    corners: list[tuple[PlanarPoint, PlanarPoint]] = [
        ((-left, back[0]), (split, back[1])),
        ((split - 0.9, back[2]), (right, back[3])),
        ((-left, back[0]), (-left - 1.5, -3)),
        ((right, back[3]), (right + 1.5, -3)),
    ]
    picks = rng.permutation(WALL_MATERIALS)
    walls: list[SceneObject] = []
    lowest = (7.0, 7.0, 4.5, 4.5)
    for (start, end), material, least in zip(corners, picks, lowest, strict=True):
        walls.append(
            WallObject(
                kind="wall",
                start=start,
                end=end,
                height_m=rng.uniform(least, least + 3),
                material=str(material),
            )
        )
    low = min(back[0], back[1]) - 0.3
    height = float(rng.uniform(2.5, 4.5))
    walls.append(
        CylinderObject(
            kind="cylinder",
            start=(-left, low, height),
            end=(split, low, height),
            radius_m=rng.uniform(0.08, 0.18),
        )
    )
    return walls


def _draw_tanks(rng: np.random.Generator) -> list[SceneObject]:
    tanks: list[SceneObject] = []
    for side in (-1, 1):
        if rng.random() < 0.75:
            center = (side * rng.uniform(3.8, 7.0), rng.uniform(2.4, 4.2))
            tanks.append(
                TankObject(
                    kind="tank",
                    center=center,
                    radius_m=rng.uniform(0.8, 1.5),
                    height_m=rng.uniform(2.5, 5.0),
                    material=str(rng.choice(["plate", "cladding", "concrete"])),
                )
            )
    return tanks


def _draw_crates(rng: np.random.Generator) -> list[SceneObject]:
    crates: list[SceneObject] = []
    for _ in range(rng.integers(4, 8)):
        size = rng.uniform(0.5, 1.5, 3)
        x = rng.uniform(YARD_M / 2, 7) * rng.choice([-1, 1])
        y = rng.uniform(-2.2, 4.5)
        crates.append(
            BoxObject(
                kind="box",
                center=(x, y, size[2] / 2),
                size=(size[0], size[1], size[2]),
                yaw_deg=rng.uniform(0, 90),
                material=str(rng.choice(CRATE_MATERIALS)),
            )
        )
    return crates


def _draw_poles(rng: np.random.Generator) -> list[SceneObject]:
    poles: list[SceneObject] = []
    for _ in range(rng.integers(2, 5)):
        x = rng.uniform(YARD_M, 9) * rng.choice([-1, 1])
        y = rng.uniform(0.5, 4.5)
        poles.append(
            CylinderObject(
                kind="cylinder",
                start=(x, y, 0),
                end=(x, y, rng.uniform(3, 7)),
                radius_m=rng.uniform(0.06, 0.16),
                material=str(rng.choice(["paint", "steel", "plate"])),
            )
        )
    return poles
