"""The factor graph of a survey: hotspots, one offset per flight, and how far columns drift.

A sighting is linear in all three: position = hotspot + J offset + lean * drift + noise. One that
fits badly loses its weight, by iteratively reweighted least squares, so that a wrong association
moves its hotspot little.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import gtsam
import numpy as np
from gtsam.symbol_shorthand import D, H, T

from geometry.arrays import FloatArray, IntArray
from geometry.covariance import standard_deviations
from locate.survey.frame import FlightOffset, PlumeSighting

DRIFT_PRIOR_M = 10.0
"""Standard deviation, before any flight, of the drift per unit of lean; chosen."""
FITS = 7.81
"""Squared residual from which a sighting loses weight: 95 % of chi-square, 3 degrees."""
REWEIGHTS = 20
"""Most iterations of the reweighting; chosen."""
SETTLED = 1e-3
"""Largest change of a weight at which the reweighting ends; chosen."""
LEAST_OFFSET = 1e-9
"""Its square is added to the variances of an offset, so that a singular one can be inverted."""


@dataclass(frozen=True, kw_only=True)
class SharedCorrections:
    """Errors that sightings share: the offsets of the flights, and the drift.

    Attributes:
        offsets: (F, 7) tangents.
        covariances: (F, 7, 7) of them.
        drift_m: Downwind shift of a column's foot per unit of lean.
        drift_sigma_m: Standard deviation of that.
    """

    offsets: FloatArray
    covariances: FloatArray
    drift_m: float
    drift_sigma_m: float

    @classmethod
    def prior(cls, offsets: Sequence[FlightOffset]) -> Self:
        """What is known before flights are compared."""
        return cls(
            offsets=np.zeros((len(offsets), 7)),
            covariances=np.reshape([one.covariance for one in offsets], (-1, 7, 7)),
            drift_m=0.0,
            drift_sigma_m=DRIFT_PRIOR_M,
        )

    def correct_positions(
        self, sightings: Sequence[PlumeSighting], leans: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(N, 3) positions without offset and drift, (N, 3, 3) what the offset leaves unsure."""
        positions, covariances = np.zeros((len(sightings), 3)), np.zeros((len(sightings), 3, 3))
        for i, one in enumerate(sightings):
            shift = one.offset_jacobian @ self.offsets[one.flight]
            shift[:2] += self.drift_m * leans[one.flight]
            positions[i] = one.position - shift
            covariances[i] = (
                one.offset_jacobian @ self.covariances[one.flight] @ one.offset_jacobian.T
            )
        return positions, covariances


@dataclass(frozen=True, kw_only=True)
class GraphSolution:
    """The solution of the graph.

    Attributes:
        positions: (K, 3) of the hotspots.
        joint: (K, K, 3, 3) covariances between them.
        weights: (N,) of the sightings, 0 to 1.
        shared: Offsets and drift.
    """

    positions: FloatArray
    joint: FloatArray
    weights: FloatArray
    shared: SharedCorrections

    @property
    def covariances(self) -> FloatArray:
        """(K, 3, 3) of the hotspots."""
        each = np.arange(len(self.positions))
        return self.joint[each, each]


def solve_graph(
    sightings: Sequence[PlumeSighting],
    hotspot_of: IntArray,
    offsets: Sequence[FlightOffset],
    leans: FloatArray,
    wander_m: float,
) -> GraphSolution:
    """Solves for hotspots, offsets and drift.

    Args:
        sightings: N of them.
        hotspot_of: (N,) index of the hotspot of each, 0 to K - 1.
        offsets: Of the F flights.
        leans: (F, 2) of the columns of each flight, the survey's mean taken out.
        wander_m: Standard deviation, each way, of the foot of a hotspot's column about it.
    """
    prior = SharedCorrections.prior(offsets)
    whiten = [
        _whitening_matrix(one.own_covariance + np.diag([wander_m**2, wander_m**2, 0.0]))
        for one in sightings
    ]
    weights = np.ones(len(sightings))
    for _ in range(REWEIGHTS):
        graph = _build_graph(sightings, hotspot_of, prior, leans, whiten, weights)
        solution = graph.optimize()
        fits = np.minimum(
            1.0, (FITS / _squared_residuals(sightings, hotspot_of, leans, whiten, solution)) ** 2
        )
        settled = np.abs(fits - weights).max(initial=0.0) < SETTLED
        weights = fits
        if settled:
            break
    return _read_solution(
        gtsam.Marginals(graph, solution), solution, weights, hotspot_of, len(offsets)
    )


def _read_solution(
    marginals: gtsam.Marginals,
    solution: gtsam.VectorValues,
    weights: FloatArray,
    hotspot_of: IntArray,
    flights: int,
) -> GraphSolution:
    """The solution with its covariances: joint those of the hotspots, its own that of a flight.

    Those between flights are left out: with them the time would grow with the cube of the flights.
    """
    hotspots = int(hotspot_of.max(initial=-1)) + 1
    keys = [D(0), *(H(k) for k in range(hotspots))]
    full = np.asarray(marginals.jointMarginalCovariance(gtsam.KeyVector(keys)).fullMatrix())
    joint = full[1:, 1:].reshape(hotspots, 3, hotspots, 3).swapaxes(1, 2)
    own = [marginals.marginalCovariance(T(f)) for f in range(flights)]
    shared = SharedCorrections(
        offsets=np.reshape([solution.at(T(f)) for f in range(flights)], (-1, 7)),
        covariances=np.reshape(own, (-1, 7, 7)),
        drift_m=float(solution.at(D(0))[0]),
        drift_sigma_m=float(standard_deviations(full)[0]),
    )
    positions = np.reshape([solution.at(H(k)) for k in range(hotspots)], (-1, 3))
    return GraphSolution(positions=positions, joint=joint, weights=weights, shared=shared)


def _build_graph(
    sightings: Sequence[PlumeSighting],
    hotspot_of: IntArray,
    prior: SharedCorrections,
    leans: FloatArray,
    whiten: Sequence[FloatArray],
    weights: FloatArray,
) -> gtsam.GaussianFactorGraph:
    graph = gtsam.GaussianFactorGraph()
    drift = np.array([[1 / prior.drift_sigma_m]])
    graph.add(gtsam.JacobianFactor(D(0), drift, np.zeros(1), _unit_noise(1)))
    for f, covariance in enumerate(prior.covariances):
        root = _whitening_matrix(covariance + LEAST_OFFSET**2 * np.eye(7))
        graph.add(gtsam.JacobianFactor(T(f), root, np.zeros(7), _unit_noise(7)))
    for one, k, root, weight in zip(sightings, hotspot_of, whiten, weights, strict=True):
        scaled = np.sqrt(weight) * root
        graph.add(
            gtsam.JacobianFactor(
                H(int(k)), scaled,
                T(one.flight), scaled @ one.offset_jacobian,
                D(0), scaled @ np.array([[*leans[one.flight], 0.0]]).T,
                scaled @ one.position,
                _unit_noise(3),
            )
        )  # fmt: skip
    return graph


def _squared_residuals(
    sightings: Sequence[PlumeSighting],
    hotspot_of: IntArray,
    leans: FloatArray,
    whiten: Sequence[FloatArray],
    solution: gtsam.VectorValues,
) -> FloatArray:
    """(N,) squared residuals in units of their noise, never quite zero."""
    squared = np.empty(len(sightings))
    for i, (one, k) in enumerate(zip(sightings, hotspot_of, strict=True)):
        left = (
            one.position - solution.at(H(int(k))) - one.offset_jacobian @ solution.at(T(one.flight))
        )
        left[:2] -= solution.at(D(0))[0] * leans[one.flight]
        squared[i] = max(float(((whiten[i] @ left) ** 2).sum()), 1e-9)
    return squared


def _whitening_matrix(covariance: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _unit_noise(size: int) -> gtsam.noiseModel.Unit:
    return gtsam.noiseModel.Unit.Create(size)
