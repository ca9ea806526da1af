"""The fit of scale, rotation and place against simulated flights with a receiver's errors.

    python -m benchmarks.georeference fit [--draws 100]

Prints a table: median errors of scale and up, and the mean normalised error squared per degree of
freedom of a point 50 m from the path; 1 is right.
"""

import argparse
from itertools import product

import numpy as np

from benchmarks.georeference.flights import (
    SimulatedFlight,
    arc,
    simulate_flight,
    strips,
    tangent_between,
)
from geometry.errors import BadInputError
from geometry.georeference import UpConstraint, fit_similarity

POINT_IN_ENU = np.array([[10.0, 5.0, 1.0]])
UP_SIGMA_RAD = float(np.radians(0.5))
FLIGHTS = {
    "strips 30 s": strips(30),
    "strips 60 s": strips(60),
    "arc 150 deg 30 s": arc(30),
    "arc 45 deg 60 s": arc(60, 45.0),
}
NOISE = ((0.0, 0.0), (0.0, 0.2), (3.0, 0.1), (10.0, 0.1))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--draws", type=int, default=100)


def main(options: argparse.Namespace) -> None:
    """Prints the table; the noise is 0.5 m horizontally and 0.8 m vertically."""
    print("flight | up | tau s | outliers | scale % (said) | tilt deg | NEES/dof | refused")
    for name, (correlation_s, outliers), known_up in product(FLIGHTS, NOISE, (False, True)):
        errors: list[list[float]] = []
        refused = 0
        for seed in range(options.draws):
            rng = np.random.default_rng([99, seed])
            flight = simulate_flight(
                FLIGHTS[name], rng, outliers=outliers, correlation_s=correlation_s
            )
            ups = [flight.gravity(rng, UP_SIGMA_RAD)] if known_up else []
            try:
                errors.append(fit_errors(flight, ups))
            except BadInputError:
                refused += 1
        scale, said, tilt_deg, _ = np.median(errors or [[np.nan] * 4], axis=0)
        mean = np.mean([row[3] for row in errors])
        print(
            f"{name} | {'0.5 deg' if known_up else '-'} | {correlation_s:.0f} | "
            f"{outliers:.1f} | {100 * scale:.2f} ({100 * said:.2f}) | {tilt_deg:.2f} | "
            f"{mean:.2f} | {refused}",
            flush=True,
        )


def fit_errors(flight: SimulatedFlight, ups: list[UpConstraint]) -> list[float]:
    """Error of the scale and its stated sigma, tilt in degrees, and NEES by degree of freedom.

    Raises:
        BadInputError: The fit is refused.
    """
    fitted = fit_similarity([flight.fixes, *ups])
    tangent = tangent_between(fitted.target_from_source, flight.enu_from_scene)
    point = fitted.target_from_source(flight.scene_from_enu(POINT_IN_ENU))
    off = (point - POINT_IN_ENU)[0]
    nees = off @ np.linalg.solve(fitted.position_covariances(point)[0], off) / 3
    tilt_deg = np.degrees(np.linalg.norm(tangent[:2]))
    return [abs(tangent[6]), fitted.scale_sigma, float(tilt_deg), float(nees)]
