"""How well the geometry alone does: fusion of true masks that were spoilt on purpose.

    python -m benchmarks.fusion geometry --draws 100 --arc 60
    python -m benchmarks.fusion geometry --draws 12 --gaps 1 2 3    # two plumes, so far apart in m

Every draw is a random column seen by 16 views from 8.5 m: 10 % of the pixels flipped, 30 % of
the views blind, a false blob in 20 % of them, poses off by 1 cm and 0.1 degrees. The displacement
is exact, and stated to be known to 0.1 px. What chance makes
of such views is worked out for the first draw and used for all: the errors hardly depend on it.
With --gaps each draw holds two plumes and works it out for itself.
"""

import argparse
from dataclasses import replace

import numpy as np

from geometry.errors import BadInputError
from locate.fusion.fuse import fuse
from locate.fusion.search.null import NullLevel
from locate.fusion.views import Views
from locate.simulation.evidence import (
    RANGE_M,
    ColumnTruth,
    add_plume,
    make_faulty_views,
    orbit_trajectory,
    random_column,
)


def fuse_draw(
    seed: int, arc_deg: float, count: int, null: NullLevel
) -> tuple[float, float, float, float, float, int] | None:
    """Of one plume, or None where it was missed.

    Returns:
        Error in m, NEES in all, in the horizontal and in the height, axis error in degrees, number
        of false plumes.
    """
    truth, views = draw_views(seed, arc_deg, count)
    plumes = fuse(views, null=null).plumes
    errors = [p.source - truth.source for p in plumes]
    if not errors or min(np.linalg.norm(e) for e in errors) > 0.15 * RANGE_M:
        return None
    best = int(np.argmin([np.linalg.norm(e) for e in errors]))
    error, plume = errors[best], plumes[best]
    nees = [
        float(error[part] @ np.linalg.solve(plume.source_covariance[part, part], error[part]))
        for part in (slice(3), slice(2), slice(2, 3))
    ]
    axis = np.degrees(np.arccos(np.clip(plume.axis @ truth.axis, -1, 1)))
    return float(np.linalg.norm(error)), nees[0], nees[1], nees[2], float(axis), len(plumes) - 1


def draw_views(seed: int, arc_deg: float, count: int) -> tuple[ColumnTruth, Views]:
    rng = np.random.default_rng(seed)
    truth = random_column(rng)
    return truth, make_faulty_views(truth, orbit_trajectory(count, arc_deg), rng)


def resolves_pair(seed: int, arc_deg: float, count: int, gap_m: float) -> bool:
    """Whether two like plumes are found, each nearer to its own source than to the middle."""
    rng = np.random.default_rng(seed)
    first = random_column(rng)
    turn = rng.uniform(0, 2 * np.pi)
    shift = gap_m * np.array([np.cos(turn), np.sin(turn), 0])
    second = replace(first, source=first.source + shift)
    trajectory = orbit_trajectory(count, arc_deg)
    views = make_faulty_views(first, trajectory, rng)
    both = add_plume(views, second, trajectory, rng)
    sources = [plume.source for plume in fuse(both).plumes]
    return all(
        any(np.linalg.norm(source - truth.source) < gap_m / 2 for source in sources)
        for truth in (first, second)
    )


def null_of(seed: int, arc_deg: float, count: int) -> NullLevel:
    _, views = draw_views(seed, arc_deg, count)
    rng = np.random.default_rng(seed)
    return NullLevel.from_views(views, views.volume(), rng, progress=lambda _share: None)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="Seed of the first draw.")
    parser.add_argument("--arc", type=float, nargs="+", default=[60.0])
    parser.add_argument("--views", type=int, default=16)
    parser.add_argument("--gaps", type=float, nargs="+", help="Two plumes, so many m apart.")


def main(options: argparse.Namespace) -> None:
    if options.draws < 1 or options.views < 1:
        raise BadInputError("--draws and --views must be at least 1")
    seeds = range(options.first, options.first + options.draws)
    if options.gaps:
        for gap_m in options.gaps:
            apart = [resolves_pair(seed, options.arc[0], options.views, gap_m) for seed in seeds]
            print(f"gap {gap_m:g} m: told apart in {sum(apart)} of {len(apart)}", flush=True)
        return
    print(
        "arc deg | found | median m | % of range | p90 m | NEES/dof | horizontal | height | "
        "axis deg | false plumes"
    )
    for arc in options.arc:
        null = null_of(options.first, arc, options.views)
        drawn = [fuse_draw(seed, arc, options.views, null) for seed in seeds]
        found = np.array([result for result in drawn if result is not None])
        if not len(found):
            print(f"{arc:7.0f} |   0/{len(drawn)}", flush=True)
            continue
        error, nees, across, along, axis, false = found.T
        print(
            f"{arc:7.0f} | {len(found):3d}/{len(drawn)} | {np.median(error):.3f} | "
            f"{100 * np.median(error) / RANGE_M:.2f} | {np.quantile(error, 0.9):.3f} | "
            f"{nees.mean() / 3:.2f} | {across.mean() / 2:.2f} | {along.mean():.2f} | "
            f"{np.median(axis):.1f} | {int(false.sum())}"
        )
