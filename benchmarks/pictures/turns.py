"""How surely the displacement turns about each place, seen from above, one panel a recording.

    python -m benchmarks.pictures turns LEAK/run work/stated/340002.npz --titles "a leak" coded \
        -o docs/images/turns.png

A recording is the folder of a run, or a file of `benchmarks.reliability film`. Each pixel is the
strongest column whose axis passes there at the lowest height. All panels have one scale. A circle
marks a true source, where it is known.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common.filmed import Recorded
from benchmarks.common.plots import blank, text
from benchmarks.reliability.answers import views_of_recording
from benchmarks.reliability.recordings import capture_of, leak_of
from detect.kinds import REGISTERED
from detect.registered import RegisteredDetector
from geometry.arrays import FloatArray, FloatMap
from geometry.errors import BadInputError
from geometry.grid import sum_evidence
from geometry.image_files import write_image
from geometry.trajectory import Trajectory
from locate.evaluation.alignment import align_trajectories
from locate.evaluation.truth import SceneTruth
from locate.export.pictures import heat_colours
from locate.fusion.matched.plumes import TurnSearch
from locate.fusion.matched.scan import StrongestByPlace, TurnVolume
from locate.fusion.matched.score import WIDTHS_UNITS
from locate.fusion.search.columns import Columns
from locate.fusion.views import Views
from locate.pipeline.files import RunFiles
from locate.survey.coverage import views_of

FULL_SCALE_SIGMAS = 12.0
PANEL_PX, LABEL_PX, GAP_PX = 300, 20, 6
PANELS_A_ROW = 3
WHITE = (255, 255, 255)


def load(recording: Path, photos: Path) -> tuple[Views, FloatArray]:
    """The views, and the (P, 3) true sources in their world."""
    if recording.suffix != ".npz":
        return views_of(recording), true_sources(recording)
    if not recording.stem.isdecimal():
        raise BadInputError(f"{recording}: no recording of benchmarks.reliability film")
    seed = int(recording.stem)
    sequence = Recorded.load(recording, capture_of(seed, photos))
    detector = RegisteredDetector(weights=REGISTERED.find_weights())
    sources = [leak_of(seed).source] if sequence.scene.plumes else []
    return views_of_recording(sequence, detector), np.reshape(sources, (-1, 3))


def measure(views: Views) -> tuple[FloatMap, FloatArray, float]:
    """(Y, X) sigmas from above, the (2,) place of the first of them, and their spacing."""
    if np.isnan(views.unit):
        raise BadInputError("no view shows how far away its background is")
    grid = sum_evidence(views.volume(), views.trajectory, views.llr, views.inverse_depth)
    search = TurnSearch.of_views(views, grid, np.random.default_rng(0))
    if search is None:
        raise BadInputError("no view tells anything about the displacement")
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


def panel(recording: Path, photos: Path, title: str) -> np.ndarray:
    """(H, W, 3) one recording."""
    views, sources = load(recording, photos)
    sigmas, corner, spacing = measure(views)
    strength = np.clip(sigmas / FULL_SCALE_SIGMAS, 0, 1)
    scale = PANEL_PX / max(strength.shape)
    picture = heat_colours(strength)[::-1]
    size = tuple(round(side * scale) for side in strength.shape[::-1])
    picture = np.ascontiguousarray(cv2.resize(picture, size, interpolation=cv2.INTER_NEAREST))
    for source in sources:
        x, y = (source[:2] - corner) / spacing * scale
        middle = (round(float(x)), round(float(size[1] - 1 - y)))
        cv2.circle(picture, middle, 10, WHITE, 1, cv2.LINE_AA)
    framed = blank(PANEL_PX + LABEL_PX, PANEL_PX + GAP_PX)
    framed[: size[1], : size[0]] = picture
    text(framed, f"{title}: {sigmas.max():.1f} sigmas", (4, PANEL_PX + 14))
    return framed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--photos", type=Path, default=Path("../shared/data/3_backgrounds"))
    parser.add_argument("--titles", nargs="+", required=True, help="One for each.")
    parser.add_argument("-o", "--output", type=Path, default=Path("work/turns.png"))


def main(options: argparse.Namespace) -> None:
    if len(options.titles) != len(options.recordings):
        raise BadInputError(
            f"{len(options.recordings)} recordings but {len(options.titles)} titles: give one each"
        )
    panels = [
        panel(recording, options.photos, title)
        for recording, title in zip(options.recordings, options.titles, strict=True)
    ]
    while len(panels) % PANELS_A_ROW:
        panels.append(np.full_like(panels[0], 255))
    rows = [np.hstack(panels[k : k + PANELS_A_ROW]) for k in range(0, len(panels), PANELS_A_ROW)]
    write_image(options.output, np.vstack(rows))
