"""What fusing the views costs against the number of plumes that they show.

    python -m benchmarks.growth plumes 1 2 5 10 20 50 [--out DIR]

Spoilt true masks of columns on one yard, at least 0.8 m apart, as of `benchmarks.fusion geometry`:
16 views of 320x240 on an arc of 60 degrees, 8.5 m from the middle. Prints how many are found within
0.5 m, how many sources are none of them, and what it took, into growth_plumes.csv.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.common.cost import peak_mib
from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.common.growth import growth_rows
from benchmarks.growth.run import CPU, MEMORY
from detect.kinds import CLUTTER_NATS
from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from locate.fusion.fuse import fuse
from locate.simulation.evidence import (
    ColumnTruth,
    add_plume,
    make_faulty_views,
    orbit_trajectory,
    random_column,
)

VIEWS, ARC_DEG = 16, 60.0
YARD_M = np.array([[-4.0, 4.0], [-3.0, 5.0]])
"""From where to where, along x and y; the cameras look along y."""
APART_M, NEAR_M = 0.8, 0.5
TRIES = 10_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("counts", type=int, nargs="*", default=[1, 2, 5, 10, 20, 50])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    costs: list[dict[str, float]] = []
    told: list[Row] = []
    for count in options.counts:
        rng = np.random.default_rng([options.seed, count])
        columns = draw_columns(count, rng)
        trajectory = orbit_trajectory(VIEWS, ARC_DEG)
        views = make_faulty_views(columns[0], trajectory, rng)
        for column in columns[1:]:
            views = add_plume(views, column, trajectory, rng)
        started_s = time.process_time()
        plumes = fuse(views, seed=options.seed, least_nats=CLUTTER_NATS * VIEWS).plumes
        costs.append({CPU: time.process_time() - started_s, MEMORY: peak_mib()})
        gaps_m = np.array(
            [[np.linalg.norm(p.source - c.source) for c in columns] for p in plumes]
        ).reshape(len(plumes), count)
        found = int((gaps_m.min(axis=0, initial=np.inf) < NEAR_M).sum())
        false = int((gaps_m.min(axis=1, initial=np.inf) >= NEAR_M).sum())
        told.append({"found": str(found), "false": str(false)})
        print(count, told[-1], costs[-1], flush=True)
    rows = growth_rows("plumes", options.counts, costs, told)
    write_table(options.out / "growth_plumes.csv", rows)


def draw_columns(count: int, rng: np.random.Generator) -> list[ColumnTruth]:
    """Columns that stand on the yard.

    Raises:
        BadInputError: There is no room for so many.
    """
    places: list[FloatArray] = []
    for _ in range(TRIES):
        if len(places) == count:
            break
        place = rng.uniform(*YARD_M.T)
        if all(np.linalg.norm(place - other) >= APART_M for other in places):
            places.append(place)
    if len(places) < count:
        raise BadInputError(f"{count} plumes do not stand {APART_M:g} m apart on the yard")
    return [replace(random_column(rng), source=np.array([*place, 0.0])) for place in places]
