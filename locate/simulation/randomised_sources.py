"""Plants whose plumes leave from anywhere, and whose nozzles mostly have none.

A network that is only shown leaks at nozzles learns that nozzles leak. Here nothing in the picture
shows where a plume is but what it does to the light.
"""

import numpy as np

from detect.synthesis.sample import log_uniform
from locate.simulation.scene import CylinderObject, PlumeSpec, Point, Scene

PLUME_FREE_SHARE = 0.4
SECOND_PLUME_SHARE = 0.3
"""How many of the scenes with a plume have a second one, up to 2 m from the first."""
AT_NOZZLE_SHARE = 0.25
YARD_M = 2.5
SCENES_PER_FLOW = 5


def randomise_sources(plant: Scene, amplitude_px: float, *, plume: bool | None = None) -> Scene:
    """A plant with more nozzles, filmed past its middle, its plumes anywhere.

    Args:
        plant: A plant without a plume.
        amplitude_px: Strength of the plumes, 95th percentile of |w|; of a second one up to three
            times weaker.
        plume: Whether there is one; None leaves that to the scene's seed.
    """
    rng = plant.random_stream(14)
    drawn = bool(rng.random() > PLUME_FREE_SHARE)
    nozzles = [_draw_nozzle(rng) for _ in range(rng.integers(1, 4))]
    sources = _draw_sources(rng, nozzles) if (drawn if plume is None else plume) else []
    plumes = tuple(_draw_plume(rng, plant, n, at, amplitude_px) for n, at in enumerate(sources))
    about = np.array(sources[0] if sources else (*rng.uniform(-1, 1, 2), 1.0))
    x, y, z = about + rng.normal(0, (0.6, 0.6, 0.3)) + (0, 0, 0.6)
    path = plant.path.model_copy(update={"target": (float(x), float(y), float(max(z, 0.6)))})
    wind = plant.random_stream(16).normal(0, 0.2, 2)
    return plant.model_copy(
        update={
            "objects": (*plant.objects, *nozzles),
            "plumes": plumes,
            "path": path,
            "wind_mps": (float(wind[0]), float(wind[1])),
        }
    )


def _draw_nozzle(rng: np.random.Generator) -> CylinderObject:
    """A pipe that ends in the open."""
    x, y = rng.uniform(-YARD_M, YARD_M, 2)
    height, radius = rng.uniform(0.3, 2.5), rng.uniform(0.05, 0.15)
    return CylinderObject(
        kind="cylinder", start=(x, y, 0.0), end=(x, y, height), radius_m=radius, material="steel"
    )


def _draw_sources(rng: np.random.Generator, nozzles: list[CylinderObject]) -> list[Point]:
    """One place or two: an exit of a nozzle, the ground, or somewhere in the air."""
    x, y = rng.uniform(-YARD_M, YARD_M, 2)
    first: Point = (x, y, float(rng.uniform(0.02, 3.0) * (rng.random() < 0.7)))
    if rng.random() < AT_NOZZLE_SHARE:
        x, y, z = nozzles[0].end
        first = (x, y, z)
    if rng.random() > SECOND_PLUME_SHARE:
        return [first]
    turn, gap_m = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 2.0)
    beside = (first[0] + gap_m * np.cos(turn), first[1] + gap_m * np.sin(turn))
    height = max(first[2] + rng.normal(0, 0.3), 0.0)
    return [first, (float(beside[0]), float(beside[1]), float(height))]


def _draw_plume(
    rng: np.random.Generator, plant: Scene, number: int, source: Point, amplitude_px: float
) -> PlumeSpec:
    """Narrow to wide, slow to fast; its flow is shared with other scenes, as it costs most."""
    flow_seed = plant.seed // SCENES_PER_FLOW
    shape = np.random.default_rng([flow_seed, 15, number])
    weaker = 1.0 if number == 0 else log_uniform(rng, (0.33, 1.0))
    return PlumeSpec(
        source=source,
        radius_m=log_uniform(shape, (0.07, 0.22)),
        height_m=shape.uniform(2.0, 4.5),
        temperature_k=shape.uniform(340, 600),
        exit_mps=log_uniform(shape, (0.2, 1.5)),
        amplitude_px=amplitude_px * weaker,
        flow_seed=flow_seed,
    )
