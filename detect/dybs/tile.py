"""One tile of an image that a plane lattice fills, demodulated."""

import cv2
import numpy as np

from detect.dybs.pattern import departure
from detect.dybs.plane import Plane
from detect.dybs.waves import Complex, halved, positions, smoothed, strongest_waves, turned
from geometry.arrays import FloatArray, FloatMap

WINDOW_PERIODS, LEAST_WINDOW_PX = (0.33, 0.45), 2.0
"""Of one wave alone, and of two that must be kept apart."""
EDGE_DOUBT = 0.95
THINNED, SOME = 4, 11
BEND_ROUNDS = 4
MISFIT_PX = 0.01
LARGEST = (0.2, 0.045, 0.05)
"""Scatter px, odd and unexplained shares: what shows more of one is no plane lattice."""


class Tile:
    """One tile; all but its spectrum and its reconstruction happen at half resolution.

    Positions are in units of its longer side, from its middle.

    Args:
        grey: (H, W), both even.
        lattice: (H, W) 1 where the lattice is, 0 elsewhere.
    """

    def __init__(self, grey: FloatMap, lattice: FloatMap) -> None:
        self._grey, self._lattice = grey, lattice
        self._side = max(grey.shape)
        self._x, self._y = positions(grey.shape, 1)
        self._half_x, self._half_y = positions(grey.shape, 2)
        at = np.stack(np.broadcast_arrays(np.float32(1), self._x, self._y)).reshape(3, -1)
        self._some = at[:, ::SOME], lattice.ravel()[::SOME], grey.ravel()[::SOME]
        self._thin = (slice(1, None, THINNED),) * 2
        self._waves, self._noise = strongest_waves(self._flattened(), lattice)
        periods_px = self._side / np.hypot(*self._waves.T)
        self._px_per_rad = periods_px / (2 * np.pi)
        share = WINDOW_PERIODS[len(self._waves) - 1]
        self._windows_px = np.maximum(share * periods_px, LEAST_WINDOW_PX)
        inside = halved(lattice)
        self._trust = np.stack([inside * self._doubt_at_edge(s) for s in self._windows_px])

    def measure(self) -> FloatMap:
        """(H/2, W/2, 5): displacement x, y; information xx, xy, yy.

        Zeros where there is no plane lattice.
        """
        plane = self._plane(self._first_phases(), self._trust)
        phases, mixed = self._followed(plane)
        strength = np.abs(mixed)
        phases += np.angle(mixed)
        trust = self._trust * strength / strength.max(axis=(1, 2), keepdims=True)
        plane = self._plane(phases, trust)
        departures = plane.scatter_px, *self._departure(phases.astype(np.float32))
        if np.greater(departures, LARGEST).any():
            return np.zeros((*strength.shape[1:], 5), np.float32)
        rest = (phases - plane.phases(self._half_x, self._half_y)).astype(np.float32)
        along = np.stack(plane.slopes(self._half_x, self._half_y)).astype(np.float32) / self._side
        windows = self._windows_px[:, None, None]
        variance = (self._noise / strength) ** 2 / (8 * np.pi * windows**2)
        certain = 1 / (variance + (MISFIT_PX / self._px_per_rad[:, None, None]) ** 2)
        parts = [*_solved(rest, along), *_information(along, certain)]
        return np.stack(parts, axis=-1).astype(np.float32)

    def _flattened(self) -> FloatMap:
        mean = (self._grey * self._lattice).sum() / self._lattice.sum()
        return np.asarray(self._grey - mean)

    def _doubt_at_edge(self, window_px: float) -> FloatMap:
        """Less than 1 where the window of a wave reaches beyond the tile."""
        sides = [
            np.minimum(np.arange(n // 2), np.arange(n // 2)[::-1]) * 2 / window_px
            for n in self._grey.shape
        ]
        nearest = np.minimum(sides[0][:, None], sides[1]).astype(np.float32)
        return np.asarray(1 - EDGE_DOUBT * np.exp(-(nearest**2) / 2))

    def _first_phases(self) -> FloatArray:
        """(Q, H/2, W/2) of each wave, as a straight one, bent quadratically, and what is left."""
        grey, phases = self._flattened() * self._lattice, []
        for wave, window_px, trust in zip(self._waves, self._windows_px, self._trust, strict=True):
            across, down = 2 * np.pi * wave
            carrier = turned(-across * self._x) * turned(-down * self._y)
            mixed = smoothed(grey * carrier, window_px)
            straight = across * self._half_x + down * self._half_y
            bend = self._bend(mixed, trust)
            mixed = mixed * turned(-bend)
            mean = mixed.sum()
            phases.append(straight + bend + np.angle(mixed * mean.conj()) + np.angle(mean))
        return np.stack(phases)

    def _bend(self, mixed: Complex, trust: FloatMap) -> FloatMap:
        """(H/2, W/2) the quadratic phase whose slopes are those of most of a wave's.

        Slopes are phase differences of neighbours, far below half a turn.
        """
        steps = [mixed[:-1, 1:] * mixed[:-1, :-1].conj(), mixed[1:, :-1] * mixed[:-1, :-1].conj()]
        slopes = np.stack([np.angle(step[self._thin]) for step in steps]) * self._side / 2
        x, y = (part[self._thin] for part in np.broadcast_arrays(self._half_x, self._half_y))
        x, y = (part[: slopes.shape[1], : slopes.shape[2]].ravel() for part in (x, y))
        weights = (np.abs(mixed) ** 2 * trust)[self._thin][: slopes.shape[1], : slopes.shape[2]]
        one, none = np.ones_like(x), np.zeros_like(x)
        terms = [(one, none), (none, one), (2 * x, none), (y, x), (none, 2 * y)]
        design = np.stack([np.concatenate(term) for term in terms], axis=-1)
        found = _robust(design, slopes.ravel(), np.tile(weights.ravel(), 2))
        at, down = self._half_x, self._half_y
        parts = (at, down, at * at, at * down, down * down)
        bend = sum(value * part for value, part in zip(found, parts, strict=True))
        return np.asarray(bend, dtype=np.float32)

    def _plane(self, phases: FloatArray, trust: FloatMap) -> Plane:
        at = np.broadcast_arrays(self._half_x, self._half_y)
        thin = (..., *self._thin)
        count = len(phases)
        return Plane.fit(
            phases[thin].reshape(count, -1),
            np.stack([part[self._thin].ravel() for part in at], axis=-1),
            trust[thin].reshape(count, -1),
            self._px_per_rad,
        )

    def _followed(self, plane: Plane) -> tuple[FloatArray, Complex]:
        """(Q, H/2, W/2) the plane's phases, and the waves mixed down by them.

        First the plane's own waves are taken out of the tile, and afterwards put back, so that
        beyond the tile's edge the windows see waves that go on rather than nothing.
        """
        waves = turned(plane.phases(self._x, self._y))
        fast = np.concatenate([np.ones_like(waves.real[:1]), waves.real, waves.imag])
        fitted = self._amplitudes(fast)
        rest = self._grey.copy()
        for (a, b, c), wave in zip(fitted, fast, strict=True):
            rest -= (a + b * self._x + c * self._y) * wave
        rest *= self._lattice
        mixed = []
        cosines, sines = np.split(fitted[1:], 2)
        for (a, b, c), wave, window_px in zip(
            (cosines - 1j * sines) / 2, waves, self._windows_px, strict=True
        ):
            plain = a + b * self._half_x + c * self._half_y
            mixed.append(plain + smoothed(rest * wave.conj(), window_px))
        return plane.phases(self._half_x, self._half_y), np.stack(mixed)

    def _amplitudes(self, fast: FloatMap) -> FloatMap:
        """(K, 3) a + b x + c y of each of (K, H, W) waves, by least squares over the lattice."""
        slow, inside, grey = self._some
        some = fast.reshape(len(fast), 1, -1)[..., ::SOME] * slow
        some = some.reshape(3 * len(fast), -1)
        weighted = some * inside
        normal = weighted @ some.T
        normal += 1e-6 * np.trace(normal) * np.eye(len(normal))
        found = np.linalg.solve(normal, weighted @ grey)
        return found.reshape(-1, 3).astype(np.float32)

    def _departure(self, phases: FloatMap) -> tuple[float, float]:
        """How little the tile looks like a pattern of the (Q, H/2, W/2) phases."""
        slow, inside, grey = self._some
        size = self._grey.shape[::-1]
        fine = np.stack([cv2.resize(map_, size).ravel()[::SOME] for map_ in phases])
        frequencies = self._waves / self._side
        return departure(grey, slow, turned(fine), frequencies, inside=inside, noise=self._noise)


def _robust(design: FloatArray, values: FloatArray, trust: FloatArray) -> FloatArray:
    """Coefficients that most of (N, P) equations agree on."""
    weights = trust
    for _ in range(BEND_ROUNDS):
        weighted = design * weights[:, None]
        found = np.linalg.lstsq(weighted.T @ design, weighted.T @ values, rcond=None)[0]
        errors = np.abs(values - design @ found)
        weights = trust / (1 + (errors / (3 * np.median(errors) + 1e-6)) ** 2)
    return np.asarray(found)


def _solved(rest: FloatMap, along: FloatMap) -> tuple[FloatMap, FloatMap]:
    """The shortest displacement, x and y, that turns the (Q, ...) phases by `rest`."""
    (ax, *bx), (ay, *by) = along
    if not bx:
        scale = rest[0] / (ax**2 + ay**2)
        return ax * scale, ay * scale
    determinant = ax * by[0] - bx[0] * ay
    return (
        (rest[0] * by[0] - rest[1] * ay) / determinant,
        (ax * rest[1] - bx[0] * rest[0]) / determinant,
    )


def _information(along: FloatMap, certain: FloatMap) -> list[FloatMap]:
    x, y = along
    return [(certain * a).sum(axis=0) for a in (x * x, x * y, y * y)]
