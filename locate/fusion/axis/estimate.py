"""The mean axis of a plume with its covariance, and the mean of several estimates of one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geometry.arrays import BoolArray, FloatArray
from locate.fusion.axis.sway import Sway

OUTLYING_SIGMAS = 3.0
"""From the median axis of several searches, beyond which one is left out: one search of four
sometimes strays (docs/archive/tried.md)."""


@dataclass(frozen=True, kw_only=True)
class AxisEstimate:
    """The mean axis of a plume, a straight line.

    Attributes:
        lowest: World Z of the column's lowest point, from which heights count.
        line: (4,) world X and Y of the axis there, and their slopes per unit of height.
        covariance: (4, 4) of `line`.
        sway: How the plume sways around it.
    """

    lowest: float
    line: FloatArray
    covariance: FloatArray
    sway: Sway

    def point_at(self, height: float) -> tuple[FloatArray, FloatArray]:
        """(3,) point of the axis at `height` and its (3, 3) covariance."""
        mix = np.zeros((3, 4))
        mix[:2] = np.hstack([np.eye(2), height * np.eye(2)])
        return mix @ self.line + [0, 0, self.lowest + height], mix @ self.covariance @ mix.T

    @property
    def rise(self) -> FloatArray:
        """(3,) the way along the axis per unit of height."""
        return np.array([*self.line[2:], 1.0])

    @property
    def direction(self) -> FloatArray:
        """(3,) unit vector of the rise."""
        return np.asarray(self.rise / np.linalg.norm(self.rise))

    @property
    def direction_sigma_rad(self) -> float:
        """Standard deviation of the direction's angle, rad (root mean square over azimuth)."""
        across = (np.eye(3) - np.outer(self.direction, self.direction))[:, :2]
        spread = across @ self.covariance[2:, 2:] @ across.T
        return float(np.sqrt(np.trace(spread) / 2) / np.linalg.norm(self.rise))

    def counting_from(self, lowest: float) -> "AxisEstimate":
        """The same axis, with heights counted from another world Z."""
        move = np.eye(4)
        move[:2, 2:] = (lowest - self.lowest) * np.eye(2)
        covariance = move @ self.covariance @ move.T
        return replace(self, lowest=lowest, line=move @ self.line, covariance=covariance)

    def cubature_lines(self) -> FloatArray:
        """(8, 4) equally likely lines with the mean and covariance of this one.

        The points of the third-degree cubature rule (Arasaratnam and Haykin, IEEE TAC 2009).
        """
        values, vectors = np.linalg.eigh(self.covariance)
        steps = 2 * (vectors * np.sqrt(np.maximum(values, 0))).T
        return np.asarray(self.line + np.concatenate([steps, -steps]))


def average_axes(axes: Sequence[AxisEstimate]) -> AxisEstimate:
    """The mean of several estimates of one plume's axis; their scatter adds to its covariance.

    Heights count from the lowest point of the first, whose sway it keeps.
    """
    alike = [axis.counting_from(axes[0].lowest) for axis in axes]
    lines = np.stack([axis.line for axis in alike])
    covariance = np.mean([axis.covariance for axis in alike], axis=0) + np.cov(lines.T, bias=True)
    return replace(alike[0], line=lines.mean(axis=0), covariance=covariance)


def mark_consistent(axes: Sequence[AxisEstimate]) -> BoolArray:
    """(N,) which of several estimates of one plume's axis lie by their median.

    Within `OUTLYING_SIGMAS` of a usual one of them, in place and slope; all, where none does.
    """
    alike = [axis.counting_from(axes[0].lowest) for axis in axes]
    lines = np.stack([axis.line for axis in alike])
    variances = np.median([axis.covariance.diagonal() for axis in alike], axis=0)
    sigmas = np.sqrt(np.maximum(variances, 0.0))
    near = (np.abs(lines - np.median(lines, axis=0)) < OUTLYING_SIGMAS * sigmas).all(axis=1)
    return near if near.any() else np.ones(len(axes), dtype=bool)
