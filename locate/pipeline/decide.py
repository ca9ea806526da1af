"""The stage that decides: evidence of all frames in, the map out."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from detect.detection import Detection
from detect.registry import DetectorChoice
from geometry.covariance import sigma_along
from geometry.grid import EvidenceGrid
from geometry.npz import save_arrays
from geometry.refraction import temperature_rise_k
from geometry.trajectory import Trajectory
from locate import __version__
from locate.fusion.fuse import fuse
from locate.fusion.search.limit import AMPLITUDES_PX, RADIUS_UNITS, detection_limit_px
from locate.fusion.still_camera.bearings import find_bearings
from locate.fusion.views import RANGE_TO_UNIT, Views
from locate.journal.progress import Report, silent
from locate.map.plume import Plume, PlumeMap
from locate.pipeline.detections import load_detections, load_response
from locate.pipeline.files import RunFiles
from locate.pipeline.placement import Placement
from locate.recording.posed_frames import PosedFrames

ONE_VIEWPOINT = (
    "The camera stood still: one viewpoint gives directions to plumes, not positions, and what "
    "moves by itself (leaves, people) may pass for one. Move the camera around for a 3D map."
)
PLUME_RANGE_SHARE = 0.7
HOTTEST_RISE_K = 2000.0
FREE_SCALE = "The scale is free: lengths are in scene units, not metres."
BLIND = (
    f"Even a plume of {AMPLITUDES_PX[-1]:.0f} px would have been missed in half of the places: "
    "that none was found says little here."
)
GUESSED_UP = "The direction of up is guessed from the scene and the cameras."


def write_map(
    files: RunFiles,
    target: RunFiles,
    posed: PosedFrames,
    *,
    seed: int,
    notes: Sequence[str],
    report: Report,
) -> str:
    """Writes the map of a run and the evidence it rests on; returns a summary.

    Args:
        files: The run folder with its earlier stages.
        target: Where to write.
        posed: The frames.
        seed: Of every random choice.
        notes: What else a reader of the map should know.
        report: Takes the progress.
    """
    plume_map = decide(files.detections, posed, target.evidence, seed=seed, report=report)
    placement = Placement.load(files.placement)
    plume_map = placement.with_uncertainty(plume_map)
    notes = (*plume_map.notes, *placement.notes, *notes)
    plume_map = replace(plume_map, notes=notes)
    plume_map.save(target.map)
    return f"{len(plume_map.plumes)} plumes, {len(plume_map.bearings)} bearings"


def decide(
    detections: Path, posed: PosedFrames, evidence: Path, *, seed: int, report: Report = silent
) -> PlumeMap:
    """Fuses the detections; writes the summed evidence where there is any.

    Args:
        detections: The folder that `measure_frames` wrote.
        posed: The frames.
        evidence: The .npz to write; a still camera has none.
        seed: Of every random choice.
        report: Told how far it is.
    """
    stored_name, indices, found = load_detections(detections)
    detector = DetectorChoice.parse(stored_name)
    trajectory = posed.undistorted_trajectory()
    if trajectory is None:
        seen = find_bearings(
            found, posed.camera.undistorted(), consecutive=posed.longest_sequence(), seed=seed
        )
        report("fusion", 1.0)
        return PlumeMap(
            units="scene",
            gravity=False,
            detector=detector.name,
            version=__version__,
            bearings=seen.bearings,
            notes=(ONE_VIEWPOINT, *seen.notes),
        )
    views = Views.from_detections(found, trajectory.take(posed.rows_of(indices)))
    fused = fuse(
        views,
        seed=seed,
        progress=lambda share: report("fusion", share),
        least_nats=detector.clutter_nats * len(views),
    )
    limit_px = None
    if fused.grid is not None:
        save_grid(fused.grid, fused.threshold_nats, evidence)
        limit_px = detection_limit_px(
            views,
            fused.threshold_nats,
            response=load_response(detections),
            seed=seed,
        )
    notes = empty_frames_notes(found, detector)
    if not trajectory.metric:
        notes.append(FREE_SCALE)
    if not trajectory.gravity:
        notes.append(GUESSED_UP)
    if limit_px is None:
        notes.append(BLIND)
    unit_name = "m" if trajectory.metric else "scene units"
    notes += [hidden_note(plume, unit_name) for plume in fused.plumes if plume.source_hidden]
    return PlumeMap(
        units="m" if trajectory.metric else "scene",
        gravity=trajectory.gravity,
        detector=detector.name,
        version=__version__,
        plumes=tuple(cap_probability(plume, detector, len(views)) for plume in fused.plumes),
        detection_limit_px=limit_px,
        detection_limit_k=_limit_k(limit_px, views, trajectory) if trajectory.metric else None,
        notes=tuple(notes),
    )


def cap_probability(plume: Plume, detector: DetectorChoice, views: int) -> Plume:
    """The plume, no surer than plumes with as much evidence a view are true.

    A network errs alike from all sides, which the draws of chance do not show.
    """
    if detector.reliability is None:
        return plume
    most = detector.reliability.true_share(plume.evidence_nats, views)
    return replace(plume, probability=min(plume.probability, most))


def empty_frames_notes(found: Sequence[Detection], detector: DetectorChoice) -> list[str]:
    """How many of the frames hold no evidence, where the detector has a note on that."""
    note = detector.empty_frames_note(sum(not each.llr.any() for each in found), len(found))
    return [] if note is None else [note]


def hidden_note(plume: Plume, unit_name: str) -> str:
    """Where along its axis a hidden source may be, from 2 sigma below to where evidence begins."""
    below = 2 * sigma_along(plume.source_covariance, plume.axis)
    above = max(0.0, min(plume.extent_low, below))
    return (
        f"Something stands before the source of plume {plume.id}: along the axis it lies between "
        f"{below:.2g} {unit_name} below and {above:.2g} {unit_name} above the stated point."
    )


def _limit_k(limit_px: float | None, views: Views, trajectory: Trajectory) -> float | None:
    """The limit as the temperature rise of a usual plume before the median background.

    None where no flame is hot enough: warm air bends light less and less as it thins.
    """
    if limit_px is None:
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


def save_grid(grid: EvidenceGrid, threshold_nats: float, path: Path) -> None:
    """Writes evidence.npz.

    Summed llr and weight (Z, Y, X), the lowest corner, the voxel's edge, and what counted as a
    plume.
    """
    save_arrays(
        path,
        llr=grid.llr.astype(np.float16),
        weight=grid.weight.astype(np.float16),
        low_in_world=grid.box.low_in_world,
        voxel=grid.box.voxel,
        threshold_nats=threshold_nats,
    )
