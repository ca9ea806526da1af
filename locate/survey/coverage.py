"""Which ground a flight covered: the weakest column it would have detected over each cell.

Cells are squares of the survey's frame, numbered from its origin, so that another flight does
not change the coverage of this one.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
from scipy.ndimage import distance_transform_edt

from detect.response import Response
from geometry.arrays import FloatArray, FloatMap, IntArray
from geometry.errors import BadInputError
from geometry.georeference import Georeference
from geometry.npz import check_numbers, read_npz, save_arrays
from geometry.trajectory import Trajectory
from locate.fusion.limit import AMPLITUDES_PX, FEWEST_VIEWS, expected_llr
from locate.fusion.search.columns import HEIGHT, RADIUS, Columns, PlumeColumn, X, Y, Z
from locate.fusion.search.null import FALSE_ALARM, NullLevel
from locate.fusion.search.score import clipped_sum, score_columns
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.pipeline.detections import INDEX, load_detections, load_response
from locate.pipeline.files import RunFiles
from locate.pipeline.fingerprint import digest
from locate.survey.flights import read_config
from locate.survey.frame import offset_of
from locate.survey.model import Flight, ReferenceColumn
from locate.survey.wind import STEEPEST_UP

MOST_CELLS = 40_000
"""Cells of one flight's window; chosen to bound memory and time."""
REACH_CELLS = 1.5
"""A cell without ground points takes the height of one this near, in cells; chosen."""
GROUND_STEP_PX = 4
"""Every so many pixels give a ground point, each way; chosen."""
FORMAT = 2
"""Version of the file; part of its key."""


@dataclass(frozen=True, kw_only=True)
class FlightCoverage:
    """The weakest columns that a flight would have detected over a window of cells.

    Attributes:
        low: (2,) number of the window's first cell, east and north; cell i spans i to i + 1 edges.
        limit_px: (H, W) displacement of the weakest column it would have detected in the cell,
            row 0 in the south; inf where none.
        seen_px: (P,) for each plume of its map, the uniform displacement of such a column that
            would have given as much evidence; inf where none would.
        key: Digest of its inputs.
    """

    low: IntArray
    limit_px: FloatMap
    seen_px: FloatMap
    key: str = ""

    def save(self, path: Path) -> None:
        """Writes an .npz, whole or not at all."""
        save_arrays(path, low=self.low, limit_px=self.limit_px, seen_px=self.seen_px, key=self.key)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            BadInputError: The file is missing or broken.
        """
        arrays = read_npz(path)
        try:
            check_numbers(**{name: array for name, array in arrays.items() if name != "key"})
            return cls(**arrays | {"key": str(arrays["key"].item())})  # type: ignore[arg-type]
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(f"{path}: not the coverage of a flight ({error})") from error


@dataclass(frozen=True, kw_only=True)
class CoverageJob:
    """The job done for each flight that is mapped: its coverage, kept in `folder`.

    Attributes:
        folder: Where NAME.npz is kept.
        frame: The survey's.
        cell_m: Edge of a cell.
        column: The reference column; its displacement does not matter here.
    """

    folder: Path
    frame: Georeference
    cell_m: float
    column: ReferenceColumn

    def __call__(self, flight: Flight) -> str | None:
        """Writes the file; returns why that is not possible, or None."""
        path = self.folder / f"{flight.name}.npz"
        try:
            key = self._cache_key(flight)
            if not _is_current(path, key):
                replace(
                    measure_coverage(flight, self.frame, self.cell_m, self.column), key=key
                ).save(path)
        except BadInputError as error:
            return str(error)
        return None

    def _cache_key(self, flight: Flight) -> str:
        made_from = (FORMAT, flight.digest, flight.map, self.frame, self.cell_m)
        shape = (self.column.radius_m, self.column.height_m)
        return digest(f"{made_from} {shape}".encode())


def _is_current(path: Path, key: str) -> bool:
    try:
        return FlightCoverage.load(path).key == key
    except BadInputError:
        return False


def measure_coverage(
    flight: Flight, frame: Georeference, cell_m: float, column: ReferenceColumn
) -> FlightCoverage:
    """Works out which ground a flight covered.

    A column is placed on the ground in the middle of every cell whose ground the flight saw. The
    evidence that its displacement gives at each pixel's own sigma is compared with the run's
    threshold for a plume, as for the map's own detection limit.

    Args:
        flight: One with a run folder that holds its detections.
        frame: The survey's.
        cell_m: Edge of a cell.
        column: The column that is placed there.

    Raises:
        BadInputError: The folder is incomplete, or the cells are too small for the ground seen.
    """
    to_survey = offset_of(flight, frame).survey_from_flight
    views = views_of(flight.folder)
    if np.isnan(views.unit):
        nothing = np.zeros((0, 0), np.float32)
        return FlightCoverage(
            low=np.zeros(2, np.int64), limit_px=nothing, seen_px=nothing[0:0].ravel()
        )
    threshold = threshold_nats(flight.folder, views)
    low, ground = ground_of(to_survey(views.background_in_world(GROUND_STEP_PX)), cell_m)
    if ground.size > MOST_CELLS:
        raise BadInputError(
            f"{flight.name}: sees {ground.size} cells of {cell_m:g} m, at most {MOST_CELLS} are "
            "kept; give larger cells with --cell"
        )
    rows, easts = np.nonzero(np.isfinite(ground))
    feet = np.column_stack(
        [
            (low[0] + easts + 0.5) * cell_m,
            (low[1] + rows + 0.5) * cell_m,
            ground[rows, easts],
        ]
    )
    limit_px = np.full(ground.shape, np.inf, np.float32)
    cells = np.zeros((len(feet), 8))
    cells[:, [X, Y, Z]] = to_survey.inverse()(feet)
    cells[:, [HEIGHT, RADIUS]] = column.height_m, column.radius_m
    plumes = flight.plume_map.plumes
    columns = Columns(cells).followed_by(Columns.of([_even_column(plume) for plume in plumes]))
    needed = np.append(np.full(len(cells), threshold), [plume.evidence_nats for plume in plumes])
    response = load_response(RunFiles(flight.folder).detections)
    found_px = column_limits_px(views, columns, needed, response)
    limit_px[rows, easts] = found_px[: len(cells)]
    return FlightCoverage(
        low=low, limit_px=limit_px, seen_px=found_px[len(cells) :].astype(np.float32)
    )


def _even_column(plume: Plume) -> PlumeColumn:
    """The column of a plume, as wide everywhere as in the median, in the frame of its map."""
    lean = plume.axis[:2] / max(float(plume.axis[2]), STEEPEST_UP)
    height = plume.extent_high * float(plume.axis[2])
    radius = float(np.median(plume.radius_by_height[:, 1]))
    return PlumeColumn(np.array([*plume.source, *lean, height, radius, 0.0]))


def views_of(folder: Path) -> Views:
    """The evidence of a run, as its fusion used it.

    Raises:
        BadInputError: Its detections are gone or broken.
    """
    if not (RunFiles(folder).detections / INDEX).is_file():
        raise BadInputError(f"{folder}: its detections are gone")
    _, indices, found = load_detections(RunFiles(folder).detections)
    trajectory = Trajectory.load(RunFiles(folder).trajectory)
    rows = np.searchsorted(trajectory.indices, indices)
    pinhole = replace(trajectory, camera=trajectory.camera.undistorted())
    return Views.from_detections(found, pinhole.take(rows))


def threshold_nats(folder: Path, views: Views) -> float:
    """The threshold of the run for a plume, nats: as stored, or drawn again with the same seed."""
    path = RunFiles(folder).evidence
    stated = read_npz(path).get("threshold_nats") if path.exists() else None
    if stated is not None:
        return float(stated)
    config = read_config(folder)
    rng = np.random.default_rng(0 if config is None else config.seed)
    null = NullLevel.from_views(views, views.volume(), rng, progress=lambda _share: None)
    return null.threshold(FALSE_ALARM)


def ground_of(points_in_survey: FloatArray, cell_m: float) -> tuple[IntArray, FloatArray]:
    """The first cell, east and north, and the (H, W) height of the ground, NaN where not seen.

    The height is the 20 % quantile of the points in a cell; a cell without points that lies
    beside one with takes that one's.
    """
    cells = np.floor(points_in_survey[:, :2] / cell_m).astype(np.int64)
    inside = (
        (cells >= np.percentile(cells, 1, axis=0)) & (cells <= np.percentile(cells, 99, axis=0))
    ).all(axis=1)
    cells, heights = cells[inside], points_in_survey[inside, 2]
    low = cells.min(axis=0)
    width, depth = cells.max(axis=0) - low + 1
    number = (cells[:, 1] - low[1]) * width + cells[:, 0] - low[0]
    order = np.lexsort([heights, number])
    number, heights = number[order], heights[order]
    starts = np.flatnonzero(np.append(True, np.diff(number) > 0))
    counts = np.diff(np.append(starts, len(number)))
    ground = np.full(width * depth, np.nan)
    ground[number[starts]] = heights[starts + counts // 5]
    ground = ground.reshape(depth, width)
    distance, (nearest_row, nearest_column) = distance_transform_edt(
        np.isnan(ground), return_indices=True
    )
    filled = ground[nearest_row, nearest_column]
    return low, np.where(distance <= REACH_CELLS, filled, np.nan)


def column_limits_px(
    views: Views, columns: Columns, needed_nats: FloatArray, response: Response | None = None
) -> FloatArray:
    """(N,) the smallest of `AMPLITUDES_PX` that gives a column its (N,) evidence, or inf."""
    limits = np.full(len(columns), np.inf)
    uniform = views.with_evidence(np.ones_like(views.llr))
    covered = score_columns(uniform, columns)
    left = np.flatnonzero((covered > 0).sum(axis=0) >= FEWEST_VIEWS)
    for amplitude in AMPLITUDES_PX:
        if not len(left):
            break
        expected = views.with_evidence(expected_llr(views, float(amplitude), response))
        found = clipped_sum(score_columns(expected, columns.take(left))) > needed_nats[left]
        limits[left[found]] = amplitude
        left = left[~found]
    return limits
