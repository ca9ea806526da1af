"""A plume in the world: its refractive index, and what that does to the rays of a camera."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import correlate1d, map_coordinates

from detect.synthesis.buoyancy import BuoyantFlow
from geometry.arrays import FloatArray, FloatMap
from geometry.refraction import AMBIENT_TEMPERATURE_K, density_deficit, refractivity
from locate.simulation.scene import Scene

CELLS = (48, 48, 96)
USED_SHARE = 0.82
"""Share of the solver's box, from the floor, whose fluid has not felt the lid."""
FADE_SHARE = 0.2
COLUMN_RADII = 5.0
CELLS_PER_RADIUS = 5
COLUMN_RISE_MPS = 1.0
CENTRAL_DIFFERENCE = np.array([1, -8, 0, 8, -1]) / 12
"""The fourth-order central difference."""
EMPTY_TRACER = 2e-3
STEP_CELLS = 1.4
FOOTPRINT_SHARE = 0.1
PERCENTILE = 95


@dataclass(frozen=True, kw_only=True)
class RayBend:
    """What a plume does to N rays, each bent once.

    Attributes:
        deflection: (N, 3) rad, the vector added to the unit direction.
        range_m: (N,) along the ray to where it bends, the |gradient|-weighted mean.
        spread_m: (N,) standard deviation about that range.
    """

    deflection: FloatMap
    range_m: FloatMap
    spread_m: FloatMap

    def share_before(self, range_m: FloatMap) -> FloatMap:
        """(N,) share of the bending that a ray has undergone when it ends at `range_m`.

        The bending is taken as even over a stretch with this mean and spread.
        """
        half = np.sqrt(3) * np.maximum(self.spread_m, 1e-3)
        share = np.clip((range_m - self.range_m) / (2 * half) + 0.5, 0, 1)
        return np.asarray(share, dtype=np.float32)


class PlumeField:
    """The refractive index of one plume at every frame.

    The box is sheared so that its upright line follows the plume downwind; a heavy gas hangs down
    from its exit.

    Attributes:
        plume: Its description in the scene.
        axis_in_world: (3,) unit mean direction in which it leaves `plume.source`.
        gain: Factor on the refractivity, 1 for the physical plume.
    """

    def __init__(self, scene: Scene, number: int) -> None:
        self.plume = scene.plumes[number]
        plume = self.plume
        deficit = density_deficit(plume.gas, plume.mole_fraction, plume.temperature_k)
        self.upward = 1.0 if deficit >= 0 else -1.0
        self.gain = 1.0
        if plume.kind == "gaussian":
            self._fill_gaussian(scene)
        else:
            self._fill_buoyant(scene, max(abs(deficit), 0.02), number)
        tilted = np.array([*self._lean, self.upward])
        self.axis_in_world = tilted / np.linalg.norm(tilted)

    def _fill_gaussian(self, scene: Scene) -> None:
        self.cell_m = self.plume.voxel_m or self.plume.radius_m / CELLS_PER_RADIUS
        half = int(COLUMN_RADII * self.plume.radius_m / self.cell_m)
        x = np.arange(-half, half + 1) * self.cell_m
        profile = np.exp(-(x[:, None] ** 2 + x**2) / (2 * self.plume.radius_m**2))
        levels = int(self.plume.height_m / self.cell_m)
        column = np.repeat(profile[..., None], levels, axis=2).astype(np.float32)
        self._tracers = [column] * scene.video.frames
        self._lean = np.array(scene.wind_mps) / COLUMN_RISE_MPS

    def _fill_buoyant(self, scene: Scene, deficit: float, number: int) -> None:
        used = int(CELLS[2] * USED_SHARE)
        plume = self.plume
        self.cell_m = plume.voxel_m or plume.height_m / used
        seed = scene.seed if plume.flow_seed is None else plume.flow_seed
        times = (scene.video.frames, scene.video.fps)
        exit_ = (self.cell_m, plume.radius_m, deficit, plume.exit_mps)
        self._tracers, rise_mps = _simulate_rise((seed, 3, number), times, exit_)
        self._lean = np.array(scene.wind_mps) / max(rise_mps, 0.1)

    def scale_to(self, physical_px: float, wanted_px: float | None) -> float:
        """Sets the gain that makes the plume as strong as is asked.

        Args:
            physical_px: How strong the physical plume is.
            wanted_px: How strong it should be; None: as it physically is.

        Returns:
            How strong the plume is with that gain, px.
        """
        if wanted_px is None or physical_px == 0:
            self.gain = 1.0
            return physical_px
        self.gain = wanted_px / physical_px
        return wanted_px

    def _index_gradient(self, frame: int) -> FloatMap:
        """(3, X, Y, Z) gradient of n in the world, 1/m, on the cells."""
        n = self._tracer_refractivity(self._tracers[frame]) - refractivity()
        slope = CENTRAL_DIFFERENCE * self.gain / self.cell_m
        gx, gy, gz = (correlate1d(n, slope, axis=axis, mode="nearest") for axis in range(3))
        gz = gz - self._lean[0] * gx - self._lean[1] * gy
        return np.asarray([gx, gy, gz * self.upward], dtype=np.float32)

    def _tracer_refractivity(self, tracer: FloatMap) -> FloatArray:
        """N - 1 where the tracer has this strength; a Gaussian column is Gaussian in n."""
        plume = self.plume
        if plume.kind == "gaussian":
            at_exit = refractivity(plume.gas, plume.mole_fraction, plume.temperature_k)
            return np.asarray(refractivity() + tracer * (at_exit - refractivity()))
        rise_k = plume.temperature_k - AMBIENT_TEMPERATURE_K
        return refractivity(
            plume.gas, tracer * plume.mole_fraction, AMBIENT_TEMPERATURE_K + tracer * rise_k
        )

    def _to_box(self, vectors: FloatArray) -> FloatArray:
        """World vectors (..., 3), in the box's sheared axes, in cells."""
        up = vectors[..., 2] * self.upward
        flat = vectors[..., :2] - self._lean * up[..., None]
        return np.concatenate([flat, up[..., None]], axis=-1) / self.cell_m

    def bend_rays(self, frame: int, center_in_world: FloatArray, directions: FloatMap) -> RayBend:
        """Follows straight rays through the plume, `eps = (1/n0) * integral(grad_perp n ds)`.

        Args:
            frame: Which moment.
            center_in_world: (3,) where all rays start.
            directions: (N, 3) unit directions in the world.
        """
        count = len(directions)
        deflection = np.zeros((count, 3), dtype=np.float32)
        mean, spread = np.zeros(count, np.float32), np.zeros(count, np.float32)
        tracer = self._tracers[frame]
        offset = (np.array(tracer.shape) - 1) / 2 * [1, 1, 0]
        start = self._to_box(center_in_world - np.array(self.plume.source)) + offset
        steps_in_box = self._to_box(directions.astype(float))
        enter, leave = _intersect_box(start, steps_in_box, *_filled_box(tracer))
        crossing = np.flatnonzero(leave > np.maximum(enter, 0))
        if len(crossing):
            enter, leave = np.maximum(enter[crossing], 0), leave[crossing]
            samples = int(np.ceil((leave - enter).max() / (STEP_CELLS * self.cell_m))) + 1
            ds = (leave - enter) / samples
            t = enter[:, None] + ds[:, None] * (np.arange(samples) + 0.5)
            places = start[:, None, None] + steps_in_box[crossing].T[:, :, None] * t
            field = self._index_gradient(frame)
            gradient = np.stack(
                [map_coordinates(g, places, order=1, output=np.float32) for g in field], axis=-1
            )
            forward = directions[crossing]
            along = np.einsum("nsk,nk->ns", gradient, forward)
            gradient -= along[..., None] * forward[:, None]
            n0 = 1 + float(refractivity())
            deflection[crossing] = gradient.sum(axis=1) * ds[:, None] / n0
            weight = np.linalg.norm(gradient, axis=-1) + 1e-12
            total = weight.sum(axis=1)
            mean[crossing] = (weight * t).sum(axis=1) / total
            variance = (weight * (t - mean[crossing, None]) ** 2).sum(axis=1) / total
            spread[crossing] = np.sqrt(variance)
        return RayBend(deflection=deflection, range_m=mean, spread_m=spread)


@lru_cache(maxsize=2)
def _simulate_rise(
    seeds: tuple[int, ...], times: tuple[int, float], exit_: tuple[float, float, float, float]
) -> tuple[list[FloatMap], float]:
    """What rises from an exit at each frame, and how fast on average, m/s.

    Args:
        seeds: Of its turbulence.
        times: How many frames, and how many a second.
        exit_: Cell and radius in m, density deficit, exit speed in m/s.
    """
    cell_m, radius_m, deficit, exit_mps = exit_
    flow = BuoyantFlow(
        CELLS,
        cell_m=cell_m,
        radius_m=radius_m,
        deficit=deficit,
        exit_mps=exit_mps,
        rng=np.random.default_rng(seeds),
    )
    flow.develop()
    used = int(CELLS[2] * USED_SHARE)
    fade = np.clip((used - np.arange(used)) / (FADE_SHARE * used), 0, 1).astype(np.float32)
    tracers, rises = [], []
    for _ in range(times[0]):
        flow.advance(1 / times[1])
        tracers.append(flow.tracer[:, :, :used] * fade)
        rises.append(flow.rise_mps())
    return tracers, float(np.mean(rises))


def _filled_box(tracer: FloatMap) -> tuple[FloatArray, FloatArray]:
    """The corners of the smallest box that holds the plume, in cells, with one to spare."""
    low, high = [], []
    for axis in range(3):
        others = tuple(i for i in range(3) if i != axis)
        there = np.flatnonzero(tracer.max(axis=others) > EMPTY_TRACER)
        first, last = (there[0], there[-1]) if len(there) else (0, 0)
        low.append(max(first - 1, 0))
        high.append(min(last + 1, tracer.shape[axis] - 1))
    return np.array(low, dtype=float), np.array(high, dtype=float)


def _intersect_box(
    start: FloatArray, steps: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where each ray `start + t * steps` enters and leaves a box; enter > leave where it misses."""
    safe = np.where(np.abs(steps) < 1e-12, 1e-12, steps)
    one, other = (low - start) / safe, (high - start) / safe
    return np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)


def visible_percentile(displacement: FloatMap) -> float:
    """95th percentile of |w| in px over the image footprint of a plume, 0 where there is none.

    The footprint is where |w| is above a tenth of its maximum.

    Args:
        displacement: (..., 2) px.
    """
    size = np.linalg.norm(displacement, axis=-1)
    peak = float(size.max(initial=0))
    if peak == 0:
        return 0.0
    return float(np.percentile(size[size > FOOTPRINT_SHARE * peak], PERCENTILE))
