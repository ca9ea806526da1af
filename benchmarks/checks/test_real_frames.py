"""The benchmark of real frames measures what it says."""

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.real_frames import run as running
from benchmarks.real_frames.cases import PLACES, cases_of, usable, why_skipped
from benchmarks.real_frames.displacement import (
    by_third,
    depth_step,
    frame_ratios,
    informed_over_true,
    measured_over_true,
    true_in_undistorted,
)
from benchmarks.real_frames.places import DEPTH_SHARES, RANGE_M, put_plume
from benchmarks.real_frames.score import CaseScore, median, median_sigma, silent_share
from benchmarks.real_frames.table import COLUMNS, row, table
from detect.detection import Detection
from detect.information import DisplacementInformation
from detect.registered.information import COMMON_SHARE
from geometry.arrays import FloatMap
from geometry.camera import Camera
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory
from locate.simulation.photo_overlay import displace_photo
from locate.simulation.photo_set import PhotoSet
from locate.simulation.scene import ImageBlock

SHAPE = (90, 120)


@pytest.fixture
def truth() -> FloatMap:
    """A column that bends light to both sides."""
    x = (np.arange(SHAPE[1]) - 60) / 12
    w = np.zeros((*SHAPE, 2), np.float32)
    w[10:80, :, 0] = x * np.exp(0.5 - x**2 / 2)
    w[..., 1] = 0.2 * w[..., 0]
    return w


@pytest.fixture
def score() -> CaseScore:
    return CaseScore(
        recording="yard",
        strength_px=1.0,
        place=0,
        poses="own",
        cpu_s=40.0,
        found=True,
        error_percent=2.0,
        nees=3.0,
        false_plumes=0,
        limit_px=0.2,
        mean_px=0.5,
        silent_share=0.25,
        sigma_px=0.1,
        ratio=0.6,
        thirds={"texture": [0.1, 0.2, 0.3], "size": [0.4, 0.5, 0.6], "edge": [None, None, None]},
    )


def test_the_size_by_normal_equations_is_that_of_the_truth(truth: FloatMap) -> None:
    rng = np.random.default_rng(7)
    gx, gy = rng.normal(size=(2, *SHAPE)).astype(np.float32)
    along = (gx * truth[..., 0] + gy * truth[..., 1]) * 0.8
    information = DisplacementInformation(
        vector=np.stack([gx * along, gy * along], axis=-1),
        matrix=np.stack([gx * gx, gx * gy, gy * gy], axis=-1),
    ).without_local_mean(COMMON_SHARE * SHAPE[1])
    assert informed_over_true(information, truth) == pytest.approx(0.8, rel=1e-3)


def test_a_damped_answer_has_its_damping_as_ratio(truth: FloatMap) -> None:
    everywhere = np.ones(SHAPE, bool)
    noise = np.random.default_rng(0).normal(0, 0.3, truth.shape).astype(np.float32)
    assert measured_over_true(0.4 * truth, truth, everywhere) == pytest.approx(0.4)
    assert measured_over_true(0.4 * truth + noise, truth, everywhere) == pytest.approx(
        0.4, abs=0.03
    )
    assert measured_over_true(-truth, truth, everywhere) == pytest.approx(-1)
    assert np.isnan(measured_over_true(truth, truth, np.zeros(SHAPE, bool)))


def test_what_was_not_measured_does_not_count(truth: FloatMap) -> None:
    known = np.ones(SHAPE, bool)
    known[:, :60] = False
    measured = np.where(known[..., None], 0.5 * truth, 0).astype(np.float32)
    image = np.zeros(SHAPE, np.uint8)
    ratios = frame_ratios(measured, known, truth, image, None)
    assert ratios.inside == pytest.approx(0.5)
    assert np.isnan(ratios.thirds["edge"]).all()
    size = np.linalg.norm(truth, axis=-1)
    assert ratios.mean_px == pytest.approx(size[size > 0.306].mean(), rel=0.03)
    silent = frame_ratios(measured, np.zeros(SHAPE, bool), truth, image, None)
    assert np.isnan(silent.inside)
    assert np.isnan(silent.thirds["texture"]).all()


def test_thirds_are_told_apart(truth: FloatMap) -> None:
    rows = np.repeat(np.arange(SHAPE[0], dtype=np.float32)[:, None], SHAPE[1], axis=1)
    inside = np.zeros(SHAPE, bool)
    inside[:, 30:90] = np.linalg.norm(truth, axis=-1)[:, 30:90] > 0.3
    first, second = np.quantile(rows[inside], [1 / 3, 2 / 3])
    factor = np.select([rows <= first, rows <= second], [0.2, 0.5], 0.8)[..., None]
    thirds = by_third((factor * truth).astype(np.float32), truth, inside, rows)
    assert thirds == pytest.approx((0.2, 0.5, 0.8))


def test_the_thirds_are_of_detail_size_and_depth(truth: FloatMap) -> None:
    grain = np.random.default_rng(1).integers(0, 255, SHAPE, dtype=np.uint8)
    image = cv2.GaussianBlur(grain, (0, 0), 1)
    image[:45] = 128
    inverse_depth = np.full(SHAPE, 0.1, np.float32)
    inverse_depth[:, 60:] = 0.2
    measured = truth.copy()
    measured[:43] *= 0.25
    known = np.ones(SHAPE, bool)
    ratios = frame_ratios(measured, known, truth, image, inverse_depth)
    low, _, high = ratios.thirds["texture"]
    assert low == pytest.approx(0.25, abs=0.05)
    assert high == pytest.approx(1, abs=0.05)
    step = depth_step(inverse_depth)
    assert np.flatnonzero((step > 0).any(axis=0)).tolist() == list(range(57, 63))
    inverse_depth[5, 5] = np.nan
    assert np.isnan(depth_step(inverse_depth)).sum() == 1


def test_truth_is_brought_to_the_frame_that_was_measured(truth: FloatMap) -> None:
    pinhole = Camera.pinhole(SHAPE[1], SHAPE[0], 100.0)
    assert true_in_undistorted(truth, pinhole) == pytest.approx(truth, abs=1e-3)
    large = 2 * cv2.resize(truth, (2 * SHAPE[1], 2 * SHAPE[0]), interpolation=cv2.INTER_LINEAR)
    assert true_in_undistorted(large, pinhole) == pytest.approx(truth, abs=0.15)
    assert true_in_undistorted(large, pinhole).max() == pytest.approx(truth.max(), rel=0.03)


def test_distortion_is_taken_out_of_the_truth() -> None:
    camera = Camera(model="SIMPLE_RADIAL", width=120, height=90, params=(100.0, 59.5, 44.5, -0.1))
    straight = camera.undistorted()
    wanted = np.full((*SHAPE, 2), (0.5, -0.25), np.float32)
    grid = camera.pixel_grid()
    rays = camera.rays(grid)
    moved = straight.rays(straight.project(rays) + wanted)
    told = true_in_undistorted((camera.project(moved) - grid).astype(np.float32), camera)
    assert told[10:-10, 10:-10] == pytest.approx(wanted[10:-10, 10:-10], abs=2e-3)


def test_silence_and_sigma() -> None:
    quiet = Detection.without_evidence(SHAPE)
    sigma = np.full(SHAPE, np.inf, np.float32)
    sigma[:30] = 0.2
    speaks = replace(quiet, sigma_px=sigma, llr=np.ones(SHAPE, np.float32))
    assert silent_share([quiet, speaks, quiet, quiet]) == 0.75
    assert median_sigma(speaks) == pytest.approx(0.2)
    assert median([median_sigma(quiet), median_sigma(speaks)]) == pytest.approx(0.2)
    assert median([median_sigma(quiet)]) is None


def test_a_row_sums_up_its_places(score: CaseScore) -> None:
    missed = replace(
        score, place=1, found=False, error_percent=None, limit_px=None, false_plumes=2, ratio=0.2
    )
    cells = [cell.strip() for cell in row([score, missed]).strip("|").split("|")]
    told = dict(zip(COLUMNS, cells, strict=True))
    assert told["found"] == "1 of 2"
    assert told["error, % of range"] == "2.00"
    assert told["false"] == "2"
    assert told["stated limit, px"] == "0.20 (1 of 2)"
    assert told["measured / true"] == "0.40"
    assert told["by texture"] == "0.10 0.20 0.30"
    assert told["by edge"] == "- - -"
    assert told["CPU s"] == "80"


def test_without_a_plume_nothing_is_found_or_missed(score: CaseScore) -> None:
    plain = replace(score, strength_px=0.0, place=None, found=None, false_plumes=1, limit_px=None)
    lines = table([plain, score, replace(score, poses="film", failure="no pose")]).splitlines()
    assert [line.split("|")[2].strip() for line in lines[2:5]] == ["0", "1", "1"]
    assert lines[2].split("|")[4].strip() == "-"
    assert lines[2].split("|")[7].strip() == "none"
    assert lines[5] == "yard, 1 px, place 0: no pose"


def test_scores_are_kept_and_done_cases_not_run_again(
    score: CaseScore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = argparse.Namespace(strengths=[0, 0.3], places=[0, 3], work=tmp_path / "work")
    cases = list(cases_of(tmp_path / "yard", options))
    assert [case.folder.name for case in cases] == ["plain", "0.3px_0", "0.3px_3"]
    assert [case.filmed for case in cases] == [True, False, False]
    path = running.score_path(cases[1], "own")
    score.save(path)
    assert CaseScore.load(path) == score
    monkeypatch.setattr(running, "run_case", None)
    assert running.score_case(cases[1], "own") == score.line()


def test_what_holds_no_frames_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "no folder" in why_skipped(tmp_path / "away")
    for i in range(12):
        assert why_skipped(tmp_path) == f"{i} frames in it, at least 12 are needed"
        (tmp_path / f"{i}.jpg").touch()
    assert why_skipped(tmp_path) == ""
    options = argparse.Namespace(recordings=[tmp_path, tmp_path / "away"])
    assert usable(options) == [tmp_path]
    assert "away | skipped: no folder" in capsys.readouterr().out


def test_what_was_filmed_elsewhere_is_a_case(tmp_path: Path) -> None:
    films = tmp_path / "films"
    (films / "0.3px").mkdir(parents=True)
    (films / "0.3px" / "truth.json").touch()
    assert why_skipped(films) == ""
    options = argparse.Namespace(strengths=[0, 0.3, 1], places=[0, 3], work=tmp_path / "work")
    cases = list(cases_of(films, options))
    assert [case.folder.name for case in cases] == ["0.3px_0", "1px_0"]
    assert [case.filmed for case in cases] == [True, False]
    assert cases[0].frames == films / "0.3px" / "frames"
    assert cases[0].folder.parent == tmp_path / "work" / "films"


def test_plumes_stand_where_they_should() -> None:
    rng = np.random.default_rng(2)
    centers = np.stack([np.linspace(-1, 1, 20), np.zeros(20), np.full(20, 1.5)], axis=1)
    rotations = np.tile([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]], (20, 1, 1))
    photos = PhotoSet(
        paths=(Path("0.png"),) * 20,
        trajectory=Trajectory(
            camera=Camera.pinhole(640, 480, 500.0),
            indices=np.arange(20),
            times_s=np.zeros(20),
            rotations=rotations,
            translations=-np.einsum("nij,nj->ni", rotations, centers),
        ),
        points_in_world=np.stack(
            [rng.uniform(-3, 3, 500), rng.uniform(4, 6, 500), rng.uniform(-1, 4, 500)], axis=1
        ),
        target_from_photos=Similarity(scale=1.0, rotation=np.eye(3), translation=np.zeros(3)),
    )
    for place in PLACES:
        scaled, scene = put_plume(photos, place)
        source = np.array(scene.plumes[0].source)
        x, y = scaled.trajectory.project(10, source)
        assert 160 <= x <= 480
        assert 288 <= y <= 408
        center = scaled.trajectory.centers_in_world[10]
        assert np.linalg.norm(source - center) == pytest.approx(RANGE_M)
        behind = scaled.points_in_world - center
        along = np.linalg.norm(source - center) / np.linalg.norm(behind, axis=1)
        assert np.isclose(along, DEPTH_SHARES[place], rtol=1e-6).any()


def test_at_full_size_only_what_is_displaced_changes() -> None:
    photo = np.random.default_rng(3).integers(0, 255, (64, 80), dtype=np.uint8)
    w = np.zeros((64, 80, 2), np.float32)
    still = displace_photo(photo, w, 1, ImageBlock(noise=0), np.random.default_rng(0))
    assert np.array_equal(still, photo)
    w[20:40, 30:50] = (1, 0)
    moved = displace_photo(photo, w, 1, ImageBlock(noise=0), np.random.default_rng(0))
    assert np.array_equal(moved[20:40, 30:50], photo[20:40, 31:51])
    w[20:40, 30:50] = 0
    changed = moved != photo
    changed[20:40, 30:50] = False
    assert not changed.any()
