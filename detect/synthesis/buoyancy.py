"""A turbulent plume: the Boussinesq equations on a small grid.

Stable fluids (Stam, SIGGRAPH 1999) with MacCormack advection (Selle et al., J. Sci. Comput. 35,
2008) and an exact projection by FFT; the sides are periodic behind a sponge.
"""

import itertools
from collections.abc import Sequence
from math import ceil

import numpy as np
import scipy.fft

from geometry.arrays import BoolArray, FloatMap

GRAVITY = 9.81
COURANT = 2.0
"""Cells that the fastest fluid may cross in a step."""
SOURCE_CELLS = 3
STILL_CELLS = 0.04
"""Fluid that crosses less of a cell in a step is left where it is."""
UNSTEADINESS = 0.15
"""Standard deviation of what leaves the exit, relative."""
WIND_CELLS = 10
"""Height at which the wind has its full speed."""
INTENSITY = 0.045
"""Share of the local speed that the eddies too small for the grid add, each way."""
EDDY_CELLS = (2.5, 5.0)
DIFFUSION_CELLS = 0.03
"""Eddy viscosity and diffusivity, square cells a step."""
CROSSINGS = 3
U, V, W, TRACER = range(4)


class BuoyantFlow:
    """A plume that rises from a disc in the floor of a box.

    The tracer is 1 at the exit and 0 in the surroundings, and drives the flow by its weight.

    Args:
        shape: Cells along x, y and up.
        cell_m: Edge of a cell.
        radius_m: Radius of the exit.
        deficit: Relative density deficit at the exit, positive.
        exit_mps: Speed of the fluid that leaves the exit.
        rng: Drives the turbulence.
        centers_m: Where the exits are, from the middle of the floor along x and y.
        turbulence: Factor on the unsteadiness of the exit and on the unresolved eddies.
        diffusion_cells: Eddy viscosity and diffusivity, square cells a step.
        wind_mps: Speed of the surroundings along x.
        solid: (X, Y, Z) cells through which nothing flows.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        *,
        cell_m: float,
        radius_m: float,
        deficit: float,
        exit_mps: float,
        rng: np.random.Generator,
        centers_m: Sequence[tuple[float, float]] = ((0.0, 0.0),),
        turbulence: float = 1.0,
        diffusion_cells: float = DIFFUSION_CELLS,
        wind_mps: float = 0.0,
        solid: BoolArray | None = None,
    ) -> None:
        self.shape = shape
        self.cell_m = cell_m
        self._buoyancy = GRAVITY * deficit
        self._exit_mps = exit_mps
        self._rng = rng
        self._turbulence = turbulence
        self._diffusion = diffusion_cells
        height = np.arange(shape[2], dtype=np.float32)
        self._wind = np.tile(wind_mps * np.clip(height / WIND_CELLS, 0, 1), (*shape[:2], 1))
        waves = [2 * np.pi * scipy.fft.fftfreq(n) for n in shape[:2]]
        waves.append(2 * np.pi * scipy.fft.rfftfreq(shape[2]))
        self._waves = np.stack(np.meshgrid(*waves, indexing="ij")).astype(np.float32)
        self._square = (self._waves**2).sum(axis=0)
        self._inverse_square = 1 / np.where(self._square == 0, np.inf, self._square)
        self._index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"))
        self._index = self._index.reshape(3, -1).astype(np.float32)
        exits = [self._exit_profile(radius_m, center) for center in centers_m]
        self._disc = np.max(exits, axis=0)
        self._sponge = self._boundary_damping()
        self._solid = solid
        if solid is not None:
            self._sponge[solid] = 0
            self._wind[solid] = 0
        self._eddies = (
            sum(self._smooth_noise(cells) for cells in EDDY_CELLS) / len(EDDY_CELLS) ** 0.5
        )
        self._eddy_cells = max(2.0, 0.8 * radius_m / cell_m)
        self.state = np.zeros((*shape, 4), dtype=np.float32)
        self.state[..., :3] = 0.06 * self._smooth_noise(4.0)
        self.state[..., U] += self._wind

    @property
    def tracer(self) -> FloatMap:
        """(X, Y, Z) strength of the plume, 0 to 1."""
        return self.state[..., TRACER]

    @property
    def top_speed_mps(self) -> float:
        """The fastest component of the velocity anywhere."""
        return float(np.abs(self.state[..., :3]).max())

    def rise_mps(self) -> float:
        """Mean upward speed of what left the exit."""
        return float((self.state[..., W] * self.tracer).sum() / max(self.tracer.sum(), 1e-9))

    def advance(self, duration_s: float) -> None:
        """Moves on by `duration_s`, in as many steps as the speed needs."""
        fastest = max(self.top_speed_mps, self._exit_mps, 0.2)
        steps = ceil(duration_s * fastest / (COURANT * self.cell_m))
        for _ in range(steps):
            self._advance_step(duration_s / steps)

    def develop(self) -> None:
        """Runs until the plume is developed: its core could have crossed the box three times."""
        height_m = self.shape[2] * self.cell_m
        crossed_m = 0.0
        while crossed_m < CROSSINGS * height_m:
            speed = max(self.top_speed_mps, self._exit_mps, 0.2)
            step_s = COURANT * self.cell_m / speed
            self._advance_step(step_s)
            crossed_m += speed * step_s

    def _exit_profile(self, radius_m: float, center_m: tuple[float, float]) -> FloatMap:
        x, y = (
            np.arange(n) - (n - 1) / 2 - c / self.cell_m
            for n, c in zip(self.shape[:2], center_m, strict=True)
        )
        radius = np.hypot(x[:, None], y) - radius_m / self.cell_m
        return np.asarray(1 / (1 + np.exp(radius / 0.5)), dtype=np.float32)

    def _boundary_damping(self) -> FloatMap:
        """(X, Y, Z, 4) what a step leaves: the sides damp everything, the lid the tracer."""
        nx, ny, nz = self.shape
        side = [np.minimum(np.arange(n), np.arange(n)[::-1]) for n in (nx, ny)]
        wall = np.clip(1 - np.minimum(side[0][:, None], side[1]) / 8, 0, 1)[..., None]
        lid = np.clip(1 - np.arange(nz)[::-1] / 10, 0, 1)
        keep = np.empty((*self.shape, 4), dtype=np.float32)
        keep[..., :3] = 1 - 0.2 * wall[..., None] ** 2
        keep[..., TRACER] = 1 - 0.3 * np.maximum(wall, lid) ** 2
        return keep

    def _smooth_noise(self, cells: float) -> FloatMap:
        """(X, Y, Z, 3) random vectors, correlated over `cells`, each component of unit size."""
        spectrum = scipy.fft.rfftn(self._rng.standard_normal((*self.shape, 3)), axes=(0, 1, 2))
        spectrum *= np.exp(-self._square * cells**2 / 2)[..., None]
        field = scipy.fft.irfftn(spectrum, s=self.shape, axes=(0, 1, 2))
        return np.asarray(field / field.std(), dtype=np.float32)

    def _advance_step(self, dt_s: float) -> None:
        self.state = self._advect_state(dt_s)
        self._feed_exit()
        self._stir_eddies(dt_s)
        self.state[..., W] += dt_s * self._buoyancy * self.state[..., TRACER]
        self.state[..., U] -= self._wind
        self.state *= self._sponge
        self.state[..., U] += self._wind
        self._project_velocity()
        if self._solid is not None:
            self.state[self._solid] = 0

    def _feed_exit(self) -> None:
        """Puts fresh fluid into the exit, unsteady as the flow in a pipe or over a fire is."""
        unsteady = 1 + UNSTEADINESS * self._turbulence * self._rng.standard_normal(self.shape[:2])
        fresh = (self._disc * np.clip(unsteady, 0, 1.5))[..., None]
        bottom = self.state[:, :, :SOURCE_CELLS]
        np.maximum(bottom[..., TRACER], fresh, out=bottom[..., TRACER])
        np.maximum(bottom[..., W], self._exit_mps * fresh, out=bottom[..., W])
        np.clip(self.state[..., TRACER], 0, 1, out=self.state[..., TRACER])

    def _stir_eddies(self, dt_s: float) -> None:
        """Kicks the moving fluid with eddies that turn over while it crosses their size."""
        offset = tuple(int(n) for n in self._rng.integers(0, self.shape))
        speed = np.abs(self.state[..., W]) * np.sqrt(np.clip(4 * self.state[..., TRACER], 0, 1))
        crossed = np.minimum(speed * (dt_s / (self._eddy_cells * self.cell_m)), 1)
        kick = INTENSITY * self._turbulence * speed * np.sqrt(2 * crossed)
        self.state[..., :3] += kick[..., None] * np.roll(self._eddies, offset, axis=(0, 1, 2))

    def _advect_state(self, dt_s: float) -> FloatMap:
        flat = self.state.reshape(-1, 4)
        shift = flat[:, :3].T * np.float32(dt_s / self.cell_m)
        moving = np.flatnonzero(np.abs(shift).max(axis=0) > STILL_CELLS)
        start, shift = self._index[:, moving], shift[:, moving]
        moved = flat.copy()
        there, low, high = self._interpolate_state(flat, start - shift)
        moved[moving] = there
        back, _, _ = self._interpolate_state(moved, start + shift)
        moved[moving] = np.clip(there + 0.5 * (flat[moving] - back), low, high)
        return moved.reshape(self.state.shape)

    def _interpolate_state(
        self, flat: FloatMap, place: FloatMap
    ) -> tuple[FloatMap, FloatMap, FloatMap]:
        """Values (N, 4) at `place` (3, N) in cells, and the least and largest of the corners."""
        nx, ny, nz = self.shape
        np.clip(place[2], 0, nz - 1.001, out=place[2])
        cell = np.floor(place)
        upper = place - cell
        i, j, k = cell.astype(np.intp)
        rows = (i % nx * (ny * nz), (i + 1) % nx * (ny * nz))
        columns = (j % ny * nz + k, (j + 1) % ny * nz + k)
        sides = (1 - upper, upper)
        total = np.zeros((place.shape[1], 4), dtype=np.float32)
        low, high = np.full_like(total, np.inf), np.full_like(total, -np.inf)
        for a, b, c in itertools.product((0, 1), repeat=3):
            values = flat.take(rows[a] + (columns[b] + c), axis=0)
            total += values * (sides[a][0] * sides[b][1] * sides[c][2])[:, None]
            np.minimum(low, values, out=low)
            np.maximum(high, values, out=high)
        return total, low, high

    def _project_velocity(self) -> None:
        """Takes the divergence out of the velocity, and spreads everything a little."""
        spectrum = scipy.fft.rfftn(self.state.transpose(3, 0, 1, 2), axes=(1, 2, 3))
        spectrum *= np.exp(-self._diffusion * self._square)
        along = (self._waves * spectrum[:3]).sum(axis=0) * self._inverse_square
        spectrum[:3] -= self._waves * along
        fields = scipy.fft.irfftn(spectrum, s=self.shape, axes=(1, 2, 3))
        self.state = np.ascontiguousarray(fields.transpose(1, 2, 3, 0))
