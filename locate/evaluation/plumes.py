"""Plumes of a map paired with the true ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from geometry.arrays import FloatArray
from geometry.similarity import Similarity
from locate.evaluation.truth import SceneTruth
from locate.map.plume import Bearing, Plume

GATE_OF_RANGE = 0.15
"""Largest source error of a pair, in ranges from the cameras; chosen."""
GATE_RAD = np.radians(10.0)
"""Largest error of a paired bearing; chosen."""


@dataclass(frozen=True, kw_only=True)
class PlumeError:
    """How far a plume of the map is from a true one.

    Attributes:
        truth: Number of the true plume in truth.json, from 0.
        plume: `id` of the plume in the map.
        error: Distance between the sources, in the unit of the truth.
        error_percent: The same in percent of the median range from the cameras to the source.
        nees: Squared error against the stated covariance; 3 is expected, NaN if it is singular.
        axis_error_deg: Angle between the axes.
    """

    truth: int
    plume: int
    error: float
    error_percent: float
    nees: float
    axis_error_deg: float


@dataclass(frozen=True, kw_only=True)
class BearingError:
    """How far a bearing is from the true direction; `bearing` counts from 0."""

    truth: int
    bearing: int
    error_deg: float
    sigmas: float


def plume_errors(
    plumes: Sequence[Plume], truth: SceneTruth, truth_from_map: Similarity
) -> list[PlumeError]:
    """Pairs plumes with true ones, at most one each, within 15 % of range."""
    sources = truth_from_map(np.reshape([plume.source for plume in plumes], (-1, 3)))
    distances = np.linalg.norm(truth.sources[:, None] - sources, axis=-1)
    errors = []
    for i, k in pair_within_gate(distances, GATE_OF_RANGE * truth.ranges[:, None]):
        plume, distance = plumes[k], float(distances[i, k])
        axis = truth_from_map.rotation @ plume.axis
        errors.append(
            PlumeError(
                truth=i,
                plume=plume.id,
                error=distance,
                error_percent=100 * distance / float(truth.ranges[i]),
                nees=_nees(
                    sources[k] - truth.sources[i],
                    truth_from_map.transform_covariance(plume.source_covariance),
                ),
                axis_error_deg=float(np.degrees(_angle_between(axis, truth.axes[i]))),
            )
        )
    return errors


def bearing_errors(bearings: Sequence[Bearing], truth: SceneTruth) -> list[BearingError]:
    """Pairs bearings of a still camera with the true directions, within 10 degrees."""
    in_cam = truth.trajectory.world_to_cam(0, truth.sources)
    true = in_cam / np.linalg.norm(in_cam, axis=1, keepdims=True)
    angles = np.array([[_angle_between(b.direction_in_cam, ray) for b in bearings] for ray in true])
    return [
        BearingError(
            truth=i,
            bearing=k,
            error_deg=float(np.degrees(angles[i, k])),
            sigmas=float(angles[i, k] / bearings[k].sigma_rad),
        )
        for i, k in pair_within_gate(angles.reshape(len(true), len(bearings)), np.array(GATE_RAD))
    ]


def pair_within_gate(cost: FloatArray, gate: FloatArray) -> list[tuple[int, int]]:
    """The one-to-one pairs (row, column) of least total cost with every cost within its gate."""
    allowed = cost <= gate
    outside = 1.0 + cost[allowed].sum()
    rows, columns = linear_sum_assignment(np.where(allowed, cost, outside))
    return [(int(i), int(k)) for i, k in zip(rows, columns, strict=True) if allowed[i, k]]


def _nees(error: FloatArray, covariance: FloatArray) -> float:
    try:
        return float(error @ np.linalg.solve(covariance, error))
    except np.linalg.LinAlgError:
        return float("nan")


def _angle_between(one: FloatArray, other: FloatArray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))
