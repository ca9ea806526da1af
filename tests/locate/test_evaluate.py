import json
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from scipy.spatial.transform import Rotation

from detect.detection import Detection
from geometry.arrays import FloatArray, FloatMap
from geometry.errors import BadInputError
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory
from locate.evaluation import evaluate_map
from locate.evaluation.alignment import align_trajectories
from locate.evaluation.plumes import pair_within_gate
from locate.evaluation.table import evaluation_table
from locate.map.plume import Bearing
from tests.locate.answers import SOURCE, orbit, plume, plume_map

MAP_FROM_TRUTH = Similarity(
    scale=0.4,
    rotation=Rotation.from_euler("xyz", [0.5, -0.8, 2.0]).as_matrix(),
    translation=np.array([3.0, -1.0, 5.0]),
)


def truth_folder(folder: Path, *sources: FloatArray, trajectory: Trajectory | None = None) -> Path:
    trajectory = trajectory or orbit(metric=True, gravity=True)
    block = {"axis": [0.0, 0.0, 1.0], "gas": "air", "amplitude_px": 1.0}
    plumes = [{"source": source.tolist(), **block} for source in sources]
    (folder / "truth.json").write_text(json.dumps(trajectory.to_dict() | {"plumes": plumes}))
    return folder


def frame_truth(folder: Path, index: int) -> tuple[FloatMap, np.ndarray]:
    displacement = np.zeros((48, 64, 2), dtype=np.float32)
    displacement[10:30, 20:40, 0] = 1.0
    mask = displacement[..., 0] > 0
    (folder / "truth").mkdir(exist_ok=True)
    np.savez(
        folder / "truth" / f"{index:06d}.npz",
        displacement=displacement,
        mask=mask,
        depth=np.ones((48, 64)),
    )
    return displacement, mask


def save_detection(folder: Path, index: int, displacement: FloatMap, llr: np.ndarray) -> None:
    folder.mkdir(exist_ok=True)
    llr = llr.astype(np.float32)
    Detection(displacement=displacement, sigma_px=np.ones_like(llr), llr=llr).save(
        folder / f"{index:06d}.npz"
    )


def test_a_perfect_map_has_no_error(tmp_path: Path) -> None:
    found = plume(axis=np.array([0.0, 0.0, 1.0]))
    verdict = evaluate_map(plume_map(found), orbit(metric=True), truth_folder(tmp_path, SOURCE))
    (error,) = verdict.plumes
    assert error.error == pytest.approx(0, abs=1e-9)
    assert error.nees == pytest.approx(0, abs=1e-9)
    assert error.axis_error_deg == pytest.approx(0, abs=1e-6)
    assert verdict.misses == verdict.false_plumes == ()


def test_errors_and_covariance_go_through_the_similarity(tmp_path: Path) -> None:
    offset = np.array([0.0, 0.03, 0.04])
    true = plume(SOURCE + offset)
    mapped = plume(
        MAP_FROM_TRUTH(true.source),
        source_covariance=MAP_FROM_TRUTH.transform_covariance(true.source_covariance),
        axis=MAP_FROM_TRUTH.rotation @ true.axis,
    )
    trajectory = orbit().transformed(MAP_FROM_TRUTH)
    verdict = evaluate_map(
        plume_map(mapped, units="scene"), trajectory, truth_folder(tmp_path, SOURCE)
    )
    (error,) = verdict.plumes
    assert verdict.alignment is not None
    assert verdict.alignment.truth_from_map.scale == pytest.approx(2.5)
    assert error.error == pytest.approx(0.05)
    median_range = np.median(np.linalg.norm(orbit().centers_in_world - SOURCE, axis=1))
    assert error.error_percent == pytest.approx(5 / median_range)
    assert error.nees == pytest.approx(offset @ np.linalg.inv(true.source_covariance) @ offset)
    assert error.axis_error_deg == pytest.approx(np.degrees(np.arctan(0.1)))


def test_a_metric_map_of_the_wrong_size_is_not_forgiven(tmp_path: Path) -> None:
    small = Similarity(scale=0.9, rotation=np.eye(3), translation=np.zeros(3))
    trajectory = orbit(metric=True).transformed(small)
    verdict = evaluate_map(
        plume_map(plume(small(SOURCE))), trajectory, truth_folder(tmp_path, SOURCE)
    )
    assert verdict.alignment is not None
    assert verdict.alignment.truth_from_map.scale == 1.0
    assert verdict.alignment.position_rmse > 0.2
    assert verdict.plumes[0].error > 0.2


def test_orientations_hold_the_roll_that_a_short_arc_leaves_free() -> None:
    rng = np.random.default_rng(3)
    truth = orbit(40, arc_deg=15.0)
    noisy = truth.centers_in_world + rng.normal(scale=0.05, size=(40, 3))
    turn = Rotation.from_rotvec(rng.normal(scale=np.radians(0.1), size=(40, 3))).as_matrix()
    rotations = turn @ truth.rotations
    estimate = Trajectory(
        camera=truth.camera,
        indices=truth.indices,
        times_s=truth.times_s,
        rotations=rotations,
        translations=-np.einsum("nij,nj->ni", rotations, noisy),
        metric=True,
    )
    alignment = align_trajectories(estimate, truth)
    assert np.linalg.norm(alignment.truth_from_map(SOURCE) - SOURCE) < 0.03
    assert alignment.rotation_median_deg == pytest.approx(0.15, abs=0.05)


def test_frames_are_matched_by_index() -> None:
    truth = orbit(12)
    some = orbit(12).take([1, 4, 7, 9])
    assert align_trajectories(some, truth).frames == 4
    assert align_trajectories(some, truth).position_rmse < 1e-9


def test_misses_and_false_plumes_are_counted(tmp_path: Path) -> None:
    far = np.array([0.0, 3.0, 0.0])
    folder = truth_folder(tmp_path, SOURCE, far)
    answer = plume_map(plume(SOURCE + 0.1), plume(SOURCE + 0.2, id=2), plume(-far, id=3))
    verdict = evaluate_map(answer, orbit(metric=True), folder)
    assert [(error.truth, error.plume) for error in verdict.plumes] == [(0, 1)]
    assert verdict.misses == (1,)
    assert verdict.false_plumes == (2, 3)


def test_no_plume_and_none_found_is_all_right(tmp_path: Path) -> None:
    verdict = evaluate_map(plume_map(), orbit(metric=True), truth_folder(tmp_path))
    assert verdict.plumes == verdict.misses == verdict.false_plumes == ()


def test_pairs_prefer_more_matches_over_nearer_ones() -> None:
    cost = np.array([[0.1, 0.9], [0.0, 5.0]])
    assert pair_within_gate(cost, np.full((2, 1), 1.0)) == [(0, 1), (1, 0)]


def test_frame_scores_tell_good_evidence_from_none(tmp_path: Path) -> None:
    folder, detections = truth_folder(tmp_path, SOURCE), tmp_path / "detections"
    for index, sign in ((0, 1.0), (2, 0.0), (4, -1.0)):
        displacement, mask = frame_truth(folder, index)
        save_detection(detections, index, 0.5 * displacement, sign * (2.0 * mask - 0.5))
    verdict = evaluate_map(plume_map(), orbit(metric=True), folder, detections)
    assert [frame.index for frame in verdict.frames] == [0, 2, 4]
    assert [frame.auroc for frame in verdict.frames] == [1.0, 0.5, 0.0]
    assert verdict.frames[0].epe_px == pytest.approx(0.5)
    assert verdict.frames[0].epe_of_zero_px == pytest.approx(1.0)
    assert verdict.frame_median("auroc") == 0.5
    assert verdict.notes == ()


def test_a_detection_of_another_size_is_resized_and_said(tmp_path: Path) -> None:
    folder, detections = truth_folder(tmp_path, SOURCE), tmp_path / "detections"
    displacement, mask = frame_truth(folder, 0)
    save_detection(detections, 0, 0.5 * displacement[::2, ::2], mask[::2, ::2])
    verdict = evaluate_map(plume_map(), orbit(metric=True), folder, detections)
    assert verdict.notes == ("detections of 32 x 24 px were resized to the truth's 64 x 48 px",)
    assert verdict.frames[0].auroc > 0.95
    assert verdict.frames[0].epe_px < 0.15


def test_a_frame_without_plume_has_no_auroc_and_json_says_null(tmp_path: Path) -> None:
    folder, detections = truth_folder(tmp_path, SOURCE), tmp_path / "detections"
    frame_truth(folder, 0)
    zeros = np.zeros((48, 64, 2), dtype=np.float32)
    np.savez(folder / "truth" / "000000.npz", displacement=zeros, mask=zeros[..., 0] > 0)
    save_detection(detections, 0, zeros, zeros[..., 0])
    content = evaluate_map(plume_map(), orbit(metric=True), folder, detections).to_dict()
    assert content["frames"][0]["auroc"] is None
    json.dumps(content, allow_nan=False)


def test_a_bearing_is_held_against_the_true_direction(tmp_path: Path) -> None:
    still = orbit(1, metric=True)
    ray = still.world_to_cam(0, SOURCE)
    ray /= np.linalg.norm(ray)
    turned = Rotation.from_rotvec([0.02, 0.0, 0.0]).apply(ray)
    bearing = Bearing(
        direction_in_cam=turned,
        sigma_rad=0.01,
        evidence_nats=9.0,
        probability=0.9,
        displacement_px=0.4,
    )
    folder = truth_folder(tmp_path, SOURCE, trajectory=still)
    verdict = evaluate_map(plume_map(bearings=(bearing,)), None, folder)
    assert verdict.bearings[0].sigmas == pytest.approx(2.0, rel=0.01)
    assert verdict.misses == ()


def test_the_table_shows_the_error(tmp_path: Path) -> None:
    folder = truth_folder(tmp_path, SOURCE)
    verdict = evaluate_map(
        plume_map(plume(SOURCE + np.array([0.1, 0.0, 0.0]))), orbit(metric=True), folder
    )
    text = StringIO()
    Console(file=text, width=100).print(evaluation_table(verdict))
    assert "0.100" in text.getvalue()
    assert "false plumes" in text.getvalue()
    assert "scene units" not in text.getvalue()


def test_the_table_has_the_unit_of_the_truth(tmp_path: Path) -> None:
    folder = truth_folder(tmp_path, SOURCE, trajectory=orbit(metric=False))
    verdict = evaluate_map(plume_map(plume(), units="scene"), orbit(), folder)
    assert verdict.to_dict()["units"] == "scene"
    text = StringIO()
    Console(file=text, width=100).print(evaluation_table(verdict))
    for quantity in ("source error", "camera position rmse"):
        (line,) = [line for line in text.getvalue().splitlines() if quantity in line]
        assert "scene units" in line


@pytest.mark.parametrize(
    ("change", "message"),
    [({"plumes": None}, "plumes"), ({"frames": []}, "share 0 frames"), ({"camera": {}}, "camera")],
)
def test_a_wrong_truth_is_bad_input(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = truth_folder(tmp_path, SOURCE) / "truth.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(BadInputError, match=message):
        evaluate_map(plume_map(), orbit(metric=True), tmp_path)


def test_a_missing_truth_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"truth\.json"):
        evaluate_map(plume_map(), orbit(), tmp_path)


def broken(path: Path, how: str) -> None:
    whole = path.read_bytes()
    match how:
        case "junk":
            path.write_bytes(b"not arrays at all")
        case "empty":
            path.write_bytes(b"")
        case "cut":
            path.write_bytes(whole[: len(whole) // 2])
        case "other":
            np.savez(path, other=np.zeros((48, 64)))


@pytest.mark.parametrize("how", ["junk", "empty", "cut", "other"])
@pytest.mark.parametrize("place", ["truth", "detections"])
def test_a_broken_frame_is_named(tmp_path: Path, place: str, how: str) -> None:
    folder, detections = truth_folder(tmp_path, SOURCE), tmp_path / "detections"
    displacement, mask = frame_truth(folder, 0)
    save_detection(detections, 0, displacement, mask)
    path = tmp_path / place / "000000.npz"
    broken(path, how)
    with pytest.raises(BadInputError) as error:
        evaluate_map(plume_map(), orbit(metric=True), folder, detections)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_truth_of_mixed_sizes_is_named(tmp_path: Path) -> None:
    folder, detections = truth_folder(tmp_path, SOURCE), tmp_path / "detections"
    displacement, mask = frame_truth(folder, 0)
    save_detection(detections, 0, displacement, mask)
    np.savez(folder / "truth" / "000000.npz", displacement=displacement, mask=mask[::2])
    with pytest.raises(BadInputError, match=r"000000\.npz: displacement is"):
        evaluate_map(plume_map(), orbit(metric=True), folder, detections)
