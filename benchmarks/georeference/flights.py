"""Simulated flights with fixes that err as receivers do."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.georeference import PositionConstraint, UpConstraint
from geometry.similarity import Similarity

SIGMAS_M = np.array([0.5, 0.5, 0.8])


def strips(n: int) -> FloatArray:
    """(N, 3) a lawn-mower path of three strips over 90 m by 50 m, its height not quite level."""
    along = np.linspace(0, 3, n)
    strip = np.minimum(along.astype(int), 2)
    share = along - strip
    east = 90 * np.where(strip % 2 == 0, share, 1 - share)
    return np.stack([east, 25.0 * strip, 40 + 3 * np.sin(2 * along)], axis=1)


def arc(n: int, degrees: float = 150.0) -> FloatArray:
    """(N, 3) on an arc of 30 m about the origin, 10 m high."""
    angles = np.radians(np.linspace(0, degrees, n))
    return np.stack([30 * np.cos(angles), 30 * np.sin(angles), np.full(n, 10.0)], axis=1)


@dataclass(frozen=True, kw_only=True)
class SimulatedFlight:
    """A flight in a scene frame of its own, and what the receiver said."""

    scene_from_enu: Similarity
    fixes: PositionConstraint

    @property
    def enu_from_scene(self) -> Similarity:
        return self.scene_from_enu.inverse()

    def gravity(self, rng: np.random.Generator, sigma_rad: float) -> UpConstraint:
        tilt = Rotation.from_rotvec([*rng.normal(size=2) * sigma_rad, 0.0]).as_matrix()
        up = self.scene_from_enu.rotation @ tilt @ [0.0, 0.0, 1.0]
        return UpConstraint(name="gimbal", up_in_source=up, sigma_rad=sigma_rad)


def simulate_flight(
    path: FloatArray,
    rng: np.random.Generator,
    *,
    outliers: float = 0.0,
    correlation_s: float = 0.0,
) -> SimulatedFlight:
    """Fixes a second apart; outliers lie up to 30 m off along each axis."""
    n = len(path)
    scene_from_enu = Similarity(
        scale=float(rng.uniform(0.1, 2.0)),
        rotation=Rotation.random(random_state=int(rng.integers(1 << 31))).as_matrix(),
        translation=rng.normal(size=3) * 10,
    )
    errors = rng.normal(size=(n, 3))
    if correlation_s:
        keep = np.exp(-1 / correlation_s)
        for i in range(1, n):
            errors[i] = keep * errors[i - 1] + np.sqrt(1 - keep**2) * errors[i]
    fixes = path + errors * SIGMAS_M
    wrong = rng.uniform(size=n) < outliers
    fixes[wrong] += rng.uniform(-30, 30, size=(int(wrong.sum()), 3))
    return SimulatedFlight(
        scene_from_enu=scene_from_enu,
        fixes=PositionConstraint(
            name="GPS",
            points_in_source=scene_from_enu(path),
            positions_in_target=fixes,
            sigmas_m=np.tile([2.0, 2.0, 4.0], (n, 1)),
            times_s=np.arange(n, dtype=float),
        ),
    )


def tangent_between(estimate: Similarity, truth: Similarity) -> FloatArray:
    """(7,) left tangent step from the estimate to the truth."""
    turn = truth.rotation @ estimate.rotation.T
    growth = truth.scale / estimate.scale
    shift = truth.translation - growth * turn @ estimate.translation
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), shift, [np.log(growth)]])
