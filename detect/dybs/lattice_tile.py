"""The displacement in one tile of an image that a plane lattice fills."""

import cv2
import numpy as np

from detect.dybs.pattern_fit import pattern_misfit
from detect.dybs.phase_plane import PhasePlane
from detect.dybs.waves import (
    ComplexMap,
    find_strongest_waves,
    halve_image,
    pixel_positions,
    smooth_halved,
    unit_phasors,
)
from geometry.arrays import FloatArray, FloatMap

WINDOW_PERIODS, LEAST_WINDOW_PX = (0.33, 0.45), 2.0
"""Standard deviation of the window, in periods: of one wave alone, and of two that must be kept
apart; at least so many px."""
EDGE_DOUBT = 0.95
"""By how much trust falls at the very edge of a tile, where half of a window is outside."""
THINNED, SOME = 4, 11
BEND_ROUNDS = 4
MISFIT_PX = 0.01
LARGEST = (0.2, 0.045, 0.05)
"""Scatter px, outlying and unexplained shares: what has more of one is no plane lattice."""


class LatticeTile:
    """One tile; all but its spectrum and its reconstruction happen at half resolution.

    Positions are in units of its longer side, from its middle.

    Args:
        grey: (H, W), both even.
        lattice: (H, W) 1 where the lattice is, 0 elsewhere.
    """

    def __init__(self, grey: FloatMap, lattice: FloatMap) -> None:
        self._grey, self._lattice = grey, lattice
        self._side = max(grey.shape)
        self._x, self._y = pixel_positions(grey.shape, 1)
        self._half_x, self._half_y = pixel_positions(grey.shape, 2)
        at = np.stack(np.broadcast_arrays(np.float32(1), self._x, self._y)).reshape(3, -1)
        self._some = at[:, ::SOME], lattice.ravel()[::SOME], grey.ravel()[::SOME]
        self._thin = (slice(1, None, THINNED),) * 2
        self._waves, self._noise = find_strongest_waves(self._without_mean(), lattice)
        periods_px = self._side / np.hypot(*self._waves.T)
        self._px_per_rad = periods_px / (2 * np.pi)
        share = WINDOW_PERIODS[len(self._waves) - 1]
        self._windows_px = np.maximum(share * periods_px, LEAST_WINDOW_PX)
        inside = halve_image(lattice)
        self._trust = np.stack([inside * self._edge_weight(s) for s in self._windows_px])

    def measure(self) -> FloatMap:
        """(H/2, W/2, 5): displacement x, y; information xx, xy, yy.

        Zeros where there is no plane lattice.
        """
        plane = self._fit_plane(self._first_phases(), self._trust)
        phases, mixed = self._mix_down(plane)
        strength = np.abs(mixed)
        phases += np.angle(mixed)
        trust = self._trust * strength / strength.max(axis=(1, 2), keepdims=True)
        plane = self._fit_plane(phases, trust)
        misfits = plane.scatter_px, *self._pattern_misfit(phases.astype(np.float32))
        if np.greater(misfits, LARGEST).any():
            return np.zeros((*strength.shape[1:], 5), np.float32)
        rest = (phases - plane.phases(self._half_x, self._half_y)).astype(np.float32)
        along = np.stack(plane.slopes(self._half_x, self._half_y)).astype(np.float32) / self._side
        windows = self._windows_px[:, None, None]
        variance = (self._noise / strength) ** 2 / (8 * np.pi * windows**2)
        certain = 1 / (variance + (MISFIT_PX / self._px_per_rad[:, None, None]) ** 2)
        parts = [*_solve_displacement(rest, along), *_information_sums(along, certain)]
        return np.stack(parts, axis=-1).astype(np.float32)

    def _without_mean(self) -> FloatMap:
        mean = (self._grey * self._lattice).sum() / self._lattice.sum()
        return np.asarray(self._grey - mean)

    def _edge_weight(self, window_px: float) -> FloatMap:
        """Less than 1 where the window of a wave reaches beyond the tile."""
        sides = [
            np.minimum(np.arange(n // 2), np.arange(n // 2)[::-1]) * 2 / window_px
            for n in self._grey.shape
        ]
        nearest = np.minimum(sides[0][:, None], sides[1]).astype(np.float32)
        return np.asarray(1 - EDGE_DOUBT * np.exp(-(nearest**2) / 2))

    def _first_phases(self) -> FloatArray:
        """(Q, H/2, W/2) of each wave, as a straight one, bent quadratically, and what is left."""
        grey, phases = self._without_mean() * self._lattice, []
        for wave, window_px, trust in zip(self._waves, self._windows_px, self._trust, strict=True):
            across, down = 2 * np.pi * wave
            carrier = unit_phasors(-across * self._x) * unit_phasors(-down * self._y)
            mixed = smooth_halved(grey * carrier, window_px)
            straight = across * self._half_x + down * self._half_y
            bend = self._fit_bend(mixed, trust)
            mixed = mixed * unit_phasors(-bend)
            mean = mixed.sum()
            phases.append(straight + bend + np.angle(mixed * mean.conj()) + np.angle(mean))
        return np.stack(phases)

    def _fit_bend(self, mixed: ComplexMap, trust: FloatMap) -> FloatMap:
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
        found = _fit_robustly(design, slopes.ravel(), np.tile(weights.ravel(), 2))
        at, down = self._half_x, self._half_y
        parts = (at, down, at * at, at * down, down * down)
        bend = sum(value * part for value, part in zip(found, parts, strict=True))
        return np.asarray(bend, dtype=np.float32)

    def _fit_plane(self, phases: FloatArray, trust: FloatMap) -> PhasePlane:
        at = np.broadcast_arrays(self._half_x, self._half_y)
        thin = (..., *self._thin)
        count = len(phases)
        return PhasePlane.fit(
            phases[thin].reshape(count, -1),
            np.stack([part[self._thin].ravel() for part in at], axis=-1),
            trust[thin].reshape(count, -1),
            self._px_per_rad,
        )

    def _mix_down(self, plane: PhasePlane) -> tuple[FloatArray, ComplexMap]:
        """(Q, H/2, W/2) the plane's phases, and the waves mixed down by them.

        First the plane's own waves are taken out of the tile, and afterwards put back, so that
        beyond the tile's edge the windows hold waves that go on rather than zeros.
        """
        waves = unit_phasors(plane.phases(self._x, self._y))
        fast = np.concatenate([np.ones_like(waves.real[:1]), waves.real, waves.imag])
        fitted = self._fit_amplitudes(fast)
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
            mixed.append(plain + smooth_halved(rest * wave.conj(), window_px))
        return plane.phases(self._half_x, self._half_y), np.stack(mixed)

    def _fit_amplitudes(self, fast: FloatMap) -> FloatMap:
        """(K, 3) a + b x + c y of each of (K, H, W) waves, by least squares over the lattice."""
        slow, inside, grey = self._some
        some = fast.reshape(len(fast), 1, -1)[..., ::SOME] * slow
        some = some.reshape(3 * len(fast), -1)
        weighted = some * inside
        normal = weighted @ some.T
        normal += 1e-6 * np.trace(normal) * np.eye(len(normal))
        found = np.linalg.solve(normal, weighted @ grey)
        return found.reshape(-1, 3).astype(np.float32)

    def _pattern_misfit(self, phases: FloatMap) -> tuple[float, float]:
        """Outlying and unexplained shares of a pattern of the (Q, H/2, W/2) phases."""
        slow, inside, grey = self._some
        size = self._grey.shape[::-1]
        fine = np.stack([cv2.resize(map_, size).ravel()[::SOME] for map_ in phases])
        frequencies = self._waves / self._side
        return pattern_misfit(
            grey, slow, unit_phasors(fine), frequencies, inside=inside, noise=self._noise
        )


def _fit_robustly(design: FloatArray, values: FloatArray, trust: FloatArray) -> FloatArray:
    """Coefficients that fit most of (N, P) equations."""
    weights = trust
    for _ in range(BEND_ROUNDS):
        weighted = design * weights[:, None]
        found = np.linalg.lstsq(weighted.T @ design, weighted.T @ values, rcond=None)[0]
        errors = np.abs(values - design @ found)
        weights = trust / (1 + (errors / (3 * np.median(errors) + 1e-6)) ** 2)
    return np.asarray(found)


def _solve_displacement(rest: FloatMap, along: FloatMap) -> tuple[FloatMap, FloatMap]:
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


def _information_sums(along: FloatMap, certain: FloatMap) -> list[FloatMap]:
    x, y = along
    return [(certain * a).sum(axis=0) for a in (x * x, x * y, y * y)]
