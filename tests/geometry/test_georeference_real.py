"""Real drone photos with real receivers, reconstructed anew."""

from pathlib import Path

import numpy as np
import pytest

from geometry.georeference import Alignment, Georeference, HeightDatum, fit_similarity
from geometry.georeference.fixes import positions_of_cameras
from geometry.georeference.gravity import up_from_gimbal, up_from_ground
from geometry.sfm import Reconstruction, reconstruct
from locate.recording import open_recording, select_frames
from locate.telemetry import TelemetryTrack, read_telemetry

pytestmark = pytest.mark.slow
SIGMAS_M = (3.0, 3.0, 6.0)


def reconstructed(folder: Path, workdir: Path) -> tuple[Reconstruction, TelemetryTrack]:
    """The scene, and the record of each of its frames."""
    frames = select_frames(open_recording(folder), workdir / "frames")
    found = reconstruct(
        workdir / "frames",
        frames.names,
        frames.indices,
        frames.times_s,
        focal_prior_px=frames.focal_prior_px,
        workdir=workdir / "sfm",
        ordered=frames.is_video,
    )
    source = {frame.name: frame.source for frame in frames.frames}
    track = read_telemetry(folder)
    return found, track.take(track.rows_of([source[name] for name in found.names]))


def local_positions(track: TelemetryTrack) -> np.ndarray:
    """(N, 3) in the frame of the first fix; heights above the sea, whichever sea."""
    fixes = np.stack([track.latitude_deg, track.longitude_deg, track.altitude_m], axis=1)
    return Georeference.from_origin(fixes[0], HeightDatum.MEAN_SEA_LEVEL, "first fix").to_enu(fixes)


def scale(fitted: Alignment) -> float:
    return fitted.target_from_source.scale


def test_brighton_beach(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "2_sfm" / "drone_brighton_beach_gps" / "images_half"
    found, track = reconstructed(folder, tmp_path)
    enu = local_positions(track)
    fixes = positions_of_cameras(found.trajectory, enu, SIGMAS_M)
    fitted = fit_similarity([fixes])
    assert fitted.sources[0].median_residual <= 0.4
    assert fitted.scale_sigma < 0.01
    gimbal = up_from_gimbal(found.trajectory, track.gimbal_pitch_deg, track.gimbal_roll_deg)
    both = fit_similarity([fixes, gimbal])
    assert both.sources[1].median_residual < 3 * both.sources[1].sigma
    assert scale(both) == pytest.approx(scale(fitted), rel=0.005)
    rng = np.random.default_rng(34)
    for _ in range(10):
        wrong = enu.copy()
        rows = rng.choice(len(wrong), size=5, replace=False)
        shifts = rng.normal(size=(5, 3))
        wrong[rows] += 34.0 * shifts / np.linalg.norm(shifts, axis=1, keepdims=True)
        with_outliers = fit_similarity([positions_of_cameras(found.trajectory, wrong, SIGMAS_M)])
        assert scale(with_outliers) == pytest.approx(scale(fitted), rel=0.03)


def test_caliterra_says_how_little_its_receiver_tells(shared_data: Path, tmp_path: Path) -> None:
    """There is no surveyed truth: what can be held against it is what it says of itself."""
    folder = shared_data / "2_sfm" / "drone_caliterra_gps" / "images_half"
    found, track = reconstructed(folder, tmp_path)
    fixes = positions_of_cameras(found.trajectory, local_positions(track), SIGMAS_M)
    ground = up_from_ground(found.trajectory, found.points_in_world)
    fitted = fit_similarity([fixes, ground])
    report = fitted.sources[0]
    assert report.outliers >= 3
    assert report.effective_count < len(fixes) / 3
    assert 0.02 < fitted.scale_sigma < 0.15
