"""Recordings as careless as those of people who never thought of refraction.

The camera strides, turns and comes closer, so that neighbours lie far apart; several things spoil
the frames at once. A network that has only seen frames registered well takes all others for plumes.
"""

from dataclasses import replace

import numpy as np

from detect.synthesis.sample import log_uniform
from locate.simulation.capture import CaptureSetup
from locate.simulation.nuisances import NUISANCES, apply_nuisances
from locate.simulation.scene import PathBlock

DEGRADED_POSE_ERROR_DEG = (0.02, 0.6)
NUISANCE_COUNT = (1, 5)
ARC_DEG = (20.0, 150.0)
JITTER_M, JITTER_DEG = (0.02, 0.2), (0.3, 3.0)


def degrade_capture(capture: CaptureSetup) -> CaptureSetup:
    """The capture along a rougher path, with one to four nuisances."""
    rng = capture.scene.random_stream(26)
    scene = capture.scene.model_copy(update={"path": _degrade_path(capture.scene.path, rng)})
    names = rng.choice(list(NUISANCES), rng.integers(*NUISANCE_COUNT), replace=False)
    return apply_nuisances(replace(capture, scene=scene), [str(name) for name in names], rng)


def _degrade_path(path: PathBlock, rng: np.random.Generator) -> PathBlock:
    changes: dict[str, object] = {
        "jitter_m": log_uniform(rng, JITTER_M),
        "jitter_deg": log_uniform(rng, JITTER_DEG),
    }
    if path.kind == "lawn_mower":
        changes["length_m"] = path.length_m * rng.uniform(1.0, 3.0)
    elif rng.random() < 0.3:
        changes |= {"kind": "approach", "end_radius_m": path.radius_m * rng.uniform(0.4, 0.9)}
    else:
        changes |= {"kind": "handheld", "arc_deg": log_uniform(rng, ARC_DEG)}
    return path.model_copy(update=changes)
