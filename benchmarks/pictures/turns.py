"""How surely the displacement turns about each place, seen from above, one panel a run.

    python -m benchmarks.pictures turns CLEAN/run LEAK/run --titles "no leak" leak \
        -o docs/images/turns.png

Each pixel is the strongest column whose axis passes there at the lowest height. All panels have one
scale. A circle marks the true source, where the folder above the run holds the truth of a scene.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common.plots import blank, text
from geometry.arrays import FloatArray, FloatMap
from geometry.errors import BadInputError
from geometry.trajectory import Trajectory
from locate.evaluation.alignment import align_trajectories
from locate.evaluation.truth import SceneTruth
from locate.export.pictures import heat_colours
from locate.fusion.fuse import fuse
from locate.fusion.matched.plumes import TurnSearch
from locate.fusion.matched.scan import StrongestByPlace, TurnVolume
from locate.fusion.matched.score import WIDTHS_UNITS
from locate.fusion.search.columns import Columns
from locate.pipeline.files import RunFiles
from locate.survey.coverage import views_of

FULL_SCALE_SIGMAS = 12.0
PANEL_PX, LABEL_PX, GAP_PX = 300, 20, 6
PANELS_A_ROW = 3
WHITE = (255, 255, 255)


def measure(run: Path) -> tuple[FloatMap, FloatArray, float]:
    """(Y, X) sigmas from above, the (2,) place of the first of them, and their spacing."""
    views = views_of(run)
    grid = fuse(views).grid
    search = None if grid is None else TurnSearch.of_views(views, grid, np.random.default_rng(0))
    if search is None:
        raise BadInputError(f"{run}: no view tells anything about the displacement")
    score, panels = search.score, []
    volumes = [
        TurnVolume.measure(score.filters, search.grid, width * views.unit) for width in WIDTHS_UNITS
    ]
    finest = volumes[0]
    size = finest.weight.shape[:0:-1]
    for volume in volumes:
        strongest = StrongestByPlace.of(volume, views.unit)
        shown = strongest.sigmas > 0
        sigmas = np.zeros(shown.shape, np.float32)
        sigmas[shown] = np.abs(score.agreed(Columns(strongest.columns[shown])))
        panels.append(cv2.resize(sigmas, size, interpolation=cv2.INTER_NEAREST))
    return np.max(panels, axis=0), finest.low[:2], float(finest.spacing[0])


def true_sources(run: Path) -> FloatArray:
    """(P, 3) true sources in the world of the run; none where no truth lies above it."""
    if not (run.parent / "truth.json").is_file():
        return np.zeros((0, 3))
    truth = SceneTruth.load(run.parent)
    trajectory = Trajectory.load(RunFiles(run).trajectory)
    transform = align_trajectories(trajectory, truth.trajectory).truth_from_map
    return np.asarray(transform.inverse()(truth.sources))


def panel(run: Path, title: str) -> np.ndarray:
    """(H, W, 3) one run."""
    sigmas, corner, spacing = measure(run)
    strength = np.clip(sigmas / FULL_SCALE_SIGMAS, 0, 1)
    scale = PANEL_PX / max(strength.shape)
    picture = heat_colours(strength)[::-1]
    size = tuple(round(side * scale) for side in strength.shape[::-1])
    picture = np.ascontiguousarray(cv2.resize(picture, size, interpolation=cv2.INTER_NEAREST))
    for source in true_sources(run):
        x, y = (source[:2] - corner) / spacing * scale
        middle = (round(float(x)), round(float(size[1] - 1 - y)))
        cv2.circle(picture, middle, 10, WHITE, 1, cv2.LINE_AA)
    framed = blank(PANEL_PX + LABEL_PX, PANEL_PX + GAP_PX)
    framed[: size[1], : size[0]] = picture
    text(framed, f"{title}: {sigmas.max():.1f} sigmas", (4, PANEL_PX + 14))
    return framed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("runs", type=Path, nargs="+", help="Folders of runs.")
    parser.add_argument("--titles", nargs="+", required=True, help="One for each.")
    parser.add_argument("-o", "--output", type=Path, default=Path("work/turns.png"))


def main(options: argparse.Namespace) -> None:
    panels = [panel(*each) for each in zip(options.runs, options.titles, strict=True)]
    while len(panels) % PANELS_A_ROW:
        panels.append(np.full_like(panels[0], 255))
    rows = [np.hstack(panels[k : k + PANELS_A_ROW]) for k in range(0, len(panels), PANELS_A_ROW)]
    cv2.imwrite(str(options.output), np.vstack(rows))
