"""The stage that decides: evidence of all frames in, the map out."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from detect.detection import Detection
from detect.haze import measure_haze
from detect.registry import DetectorChoice
from detect.response import Response
from geometry.printable import printable
from geometry.refraction import temperature_rise_k
from geometry.reports import Report, ignore_report
from geometry.trajectory import Trajectory
from locate import __version__
from locate.fusion.find import FoundPlumes, find_plumes
from locate.fusion.limit import RADIUS_UNITS
from locate.fusion.still_camera.bearings import find_bearings
from locate.fusion.views import RANGE_TO_UNIT, Views
from locate.map.answer import Answer, Cause, Obstacle
from locate.map.plume import PlumeMap
from locate.pipeline.detections import load_detections, load_response
from locate.pipeline.evidence import save_evidence
from locate.pipeline.files import RunFiles
from locate.pipeline.map_notes import ONE_VIEWPOINT, map_notes
from locate.pipeline.more_frames import MoreFrames
from locate.pipeline.obstacles import measured_obstacles
from locate.pipeline.placement import Placement
from locate.recording.posed_frames import PosedFrames

PLUME_RANGE_SHARE = 0.7
"""Range of a usual plume, in ranges of the median background; chosen by hand."""
FIRST_SHARE, SECOND_SHARE = 0.3, 0.6
"""Shares of fusion's time before more frames are measured, and after, for the progress."""
HOTTEST_RISE_K = 2000.0
"""About what a flame reaches; a limit above that is none."""


def write_map(
    files: RunFiles,
    target: RunFiles,
    posed: PosedFrames,
    *,
    seed: int,
    notes: Sequence[str],
    foreseen: Sequence[Obstacle] = (),
    more: MoreFrames | None = None,
    report: Report,
) -> str:
    """Writes the map of a run and the evidence it rests on; returns a summary.

    Args:
        files: The run folder with its earlier stages.
        target: Where to write.
        posed: The frames.
        seed: Of every random choice.
        notes: What else a reader of the map should know.
        foreseen: Obstacles that the frames themselves show.
        more: Measures more frames where the answer is unsure.
        report: Takes the progress.
    """
    plume_map = fuse_detections(
        files.detections,
        posed,
        target.evidence,
        seed=seed,
        more=more,
        coarse_coding=any(each.cause is Cause.COARSE_CODING for each in foreseen),
        report=report,
    )
    placement = Placement.load(files.placement)
    plume_map = placement.with_uncertainty(plume_map)
    if plume_map.answer is Answer.NOT_JUDGED:
        plume_map = replace(plume_map, obstacles=(*foreseen, *plume_map.obstacles))
    else:
        notes = (*notes, *(obstacle.why for obstacle in foreseen))
    notes = (*plume_map.notes, *placement.notes, *notes)
    plume_map = replace(plume_map, notes=tuple(map(printable, notes)))
    plume_map.save(target.map)
    return plume_map.limit_text()


def fuse_detections(
    detections: Path,
    posed: PosedFrames,
    evidence: Path,
    *,
    seed: int,
    coarse_coding: bool = False,
    more: MoreFrames | None = None,
    report: Report = ignore_report,
) -> PlumeMap:
    """Fuses the detections; writes the summed evidence where there is any.

    Args:
        detections: The folder that `measure_frames` wrote.
        posed: The frames.
        evidence: The .npz to write; a camera at rest has none.
        seed: Of every random choice.
        coarse_coding: The video has few bits a pixel.
        more: Measures more frames where the answer is unsure.
        report: Takes the progress.
    """
    stored_name, indices, measured = load_detections(detections)
    detector = DetectorChoice.parse(stored_name)
    trajectory = posed.undistorted_trajectory()
    if trajectory is None:
        response = load_response(detections)
        plume_map = map_bearings(
            measured, detector, posed, response=response, seed=seed, coarse_coding=coarse_coding
        )
        report("fusion", 1.0)
        return plume_map
    find = partial(find_plumes, detector=detector, response=load_response(detections), seed=seed)
    views, found = _find_in_frames(
        posed,
        trajectory,
        indices,
        measured,
        find=find,
        more=more,
        folder=evidence.parent,
        report=report,
    )
    if found.grid is not None:
        save_evidence(found.grid, found.threshold_nats, evidence)
    judged = bool(found.plumes) or found.limit_px is not None
    obstacles = () if judged else measured_obstacles(measured, depth=found.grid is not None)
    return PlumeMap(
        units="m" if trajectory.metric else "scene",
        gravity=trajectory.gravity,
        detector=detector.name,
        version=__version__,
        plumes=found.plumes,
        detection_limit_px=found.limit_px,
        detection_limit_k=_limit_k(found.limit_px, views, trajectory),
        obstacles=obstacles,
        notes=map_notes(
            measured, detector, trajectory, found, obstacles, more=views.displacement_only
        ),
    )


def _find_in_frames(
    posed: PosedFrames,
    trajectory: Trajectory,
    indices: list[int],
    measured: Sequence[Detection],
    *,
    find: Callable[..., FoundPlumes],
    more: MoreFrames | None,
    folder: Path,
    report: Report,
) -> tuple[Views, FoundPlumes]:
    """What the measured frames show; where that is unsure, with the displacement of more frames.

    Returns:
        The views, and what they show.
    """

    def part(low: float, high: float) -> Callable[[float], None]:
        return lambda share: report("fusion", low + share * (high - low))

    views = Views.from_detections(measured, trajectory.take(posed.rows_of(indices)))
    if more is None:
        return views, find(views, progress=part(0.0, 1.0))
    found = None
    if not more.always:
        found = find(views, progress=part(0.0, FIRST_SHARE))
        if not found.is_unsure:
            report("fusion", 1.0)
            return views, found
    others, displacements = more.measure(posed, indices, folder, part(FIRST_SHARE, SECOND_SHARE))
    if found is not None and not others:
        report("fusion", 1.0)
        return views, found
    by_pixels = None if found is None else found.by_pixels
    rows = posed.rows_of([*indices, *others])
    views = Views.from_detections(measured, trajectory.take(rows), displacements)
    del found, displacements  # they hold as much memory as the second search
    return views, find(views, by_pixels=by_pixels, progress=part(SECOND_SHARE, 1.0))


def map_bearings(
    found: Sequence[Detection],
    detector: DetectorChoice,
    posed: PosedFrames,
    *,
    response: Response | None,
    seed: int,
    coarse_coding: bool = False,
) -> PlumeMap:
    """The map of a camera at rest: directions to plumes.

    Coarse coding explains by itself why nothing can be judged.
    """
    images = posed.steady()
    haze = measure_haze(images)
    seen = find_bearings(
        found,
        posed.camera.undistorted(),
        consecutive=images[posed.longest_sequence()],
        haze=haze,
        shaking_px=images.shaking_px,
        coarse_coding=coarse_coding,
        response=response,
        seed=seed,
    )
    judged = bool(seen.bearings) or seen.limit_px is not None
    return PlumeMap(
        units="scene",
        gravity=False,
        detector=detector.name,
        version=__version__,
        bearings=seen.bearings,
        haze=haze,
        detection_limit_px=seen.limit_px,
        obstacles=() if judged or coarse_coding else measured_obstacles(found, depth=True),
        notes=(ONE_VIEWPOINT, *seen.notes),
    )


def _limit_k(limit_px: float | None, views: Views, trajectory: Trajectory) -> float | None:
    """The limit as the temperature rise of a usual plume before the median background.

    None where lengths are not metres, or no flame is hot enough: warm air bends light less and
    less as it thins.
    """
    if limit_px is None or not trajectory.metric:
        return None
    range_m = views.unit / RANGE_TO_UNIT
    rise_k = temperature_rise_k(
        limit_px,
        radius_m=RADIUS_UNITS * views.unit,
        range_to_plume_m=PLUME_RANGE_SHARE * range_m,
        range_to_background_m=range_m,
        focal_px=trajectory.camera.focal_px,
    )
    return rise_k if rise_k < HOTTEST_RISE_K else None
