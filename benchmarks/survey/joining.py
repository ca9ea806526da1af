"""What joining the flights of a survey costs: CPU s and memory against the number of flights.

    python -m benchmarks.survey joining 100 200 400 800 1600 [--out DIR]

Each flight sees 4 of 20 hotspots. Writes survey_joining.csv, with fitted exponents.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from benchmarks.common.cost import peak_mib
from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.common.growth import growth_rows
from benchmarks.survey.sightings import offset_of, sighting
from geometry.arrays import FloatArray
from locate.survey.associate import associate
from locate.survey.frame import PlumeSighting

AREA_M, HOTSPOTS, SEEN = 400.0, 20, 4
OWN_M, WANDER_M, DRIFT_M, LEAN = 0.3, 0.5, 4.0, 0.1
OFFSET_SIGMAS = np.array([0.002, 0.002, 0.004, 1.0, 1.0, 2.0, 0.002])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flights", type=int, nargs="*", default=[100, 200, 400, 800, 1600])
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    costs: list[dict[str, float]] = []
    told: list[Row] = []
    for flights in options.flights:
        rng = np.random.default_rng(flights)
        sites = np.c_[rng.uniform(0, AREA_M, (HOTSPOTS, 2)), np.zeros(HOTSPOTS)]
        leans = rng.normal(0, LEAN, (flights, 2))
        seen = flown(sites, leans, rng)
        kept = [
            HOTSPOTS * flight + site
            for flight in range(flights)
            for site in rng.permutation(HOTSPOTS)[:SEEN]
        ]
        start = time.process_time()
        fused = associate(
            [seen[i] for i in kept],
            [offset_of(flight, OFFSET_SIGMAS) for flight in range(flights)],
            leans,
            wander_m=WANDER_M,
            area_m2=AREA_M**2,
        )
        costs.append({"CPU s": time.process_time() - start, "MiB": peak_mib()})
        found = len(np.unique(fused.hotspot_of))
        told.append({"sightings": str(len(kept)), f"hotspots of {HOTSPOTS}": str(found)})
    rows = growth_rows("flights", options.flights, costs, told)
    write_table(options.out / "survey_joining.csv", rows)


def flown(sites: FloatArray, leans: FloatArray, rng: np.random.Generator) -> list[PlumeSighting]:
    """Every site as every flight sees it."""
    seen = []
    for flight, lean in enumerate(leans):
        offset = OFFSET_SIGMAS * rng.normal(size=7)
        for site in sites:
            foot = site.copy()
            foot[:2] += rng.normal(0, WANDER_M, 2) + DRIFT_M * lean
            seen.append(sighting(flight, foot, offset, OWN_M, rng))
    return seen
