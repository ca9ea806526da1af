import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from geometry.errors import BadInputError
from geometry.georeference.board import marker_board
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory
from locate.cli import app
from locate.pipeline.config import RunConfig
from locate.pipeline.known_lengths import KnownDistance, KnownLengths, parse_board
from locate.pipeline.placement import Placement
from locate.pipeline.run import Run
from tests.geometry.surveys import looking_down

SHEET_M, SHEET_PX = 3.0, 1500
BOARD = "4X4_50:0.2:2x2:0.05"
SCALE = 0.25
SCENE_FROM_WORLD = Similarity(
    scale=SCALE,
    rotation=Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix(),
    translation=np.array([1.0, 2, 3]),
)
ENDS_M = {"drum": np.array([-0.6, 0.4, 0.0]), "valve": np.array([0.5, -0.5, 0.0])}


@pytest.fixture(scope="module")
def cameras() -> Trajectory:
    centers = np.array([[x, y, 1.7] for y in (-0.3, 0.3) for x in (-0.4, -0.1, 0.2, 0.5)])
    return looking_down(centers, tilt=Rotation.from_euler("xz", [10, 15], degrees=True))


@pytest.fixture(scope="module")
def photos(cameras: Trajectory, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photos of a textured sheet on the ground with the board in its middle."""
    rng = np.random.default_rng(2)
    sheet = cv2.resize(rng.uniform(60, 200, (150, 150)), (SHEET_PX, SHEET_PX)).astype(np.uint8)
    side_px = round(0.45 / SHEET_M * SHEET_PX)
    print_px = parse_board(BOARD).generateImage((side_px, side_px), marginSize=0)
    low = (SHEET_PX - side_px) // 2
    sheet[low - 10 : low + side_px + 10, low - 10 : low + side_px + 10] = 255
    sheet[low : low + side_px, low : low + side_px] = print_px
    half, n = SHEET_M / 2, SHEET_PX
    corners_m = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    on_sheet = np.array([[0, 0], [n, 0], [n, n], [0, n]], dtype=np.float32) - np.float32(0.5)
    folder = tmp_path_factory.mktemp("photos")
    for row in range(len(cameras)):
        seen = cameras.project(row, corners_m).astype(np.float32)
        view = cv2.getPerspectiveTransform(on_sheet, seen)
        image = cv2.warpPerspective(sheet, view, (640, 480), flags=cv2.INTER_AREA)
        cv2.imwrite(str(folder / f"{row:06d}.png"), image)
    return folder


def write_distance(path: Path, cameras: Trajectory, **changes: object) -> Path:
    points = {
        name: {f"{row:06d}.png": cameras.project(row, place[None])[0].tolist() for row in (0, 3, 6)}
        for name, place in ENDS_M.items()
    }
    apart = float(np.linalg.norm(ENDS_M["drum"] - ENDS_M["valve"]))
    path.write_text(json.dumps({"distance_m": apart, "points": points} | changes))
    return path


def placed(photos: Path, cameras: Trajectory, folder: Path, **options: object) -> Placement:
    poses = folder / "poses.json"
    scene = cameras.transformed(SCENE_FROM_WORLD)
    replace(scene, metric=False, gravity=False).save(poses)
    config = RunConfig(recording=photos, poses=poses, detector="registered-plain", **options)
    Run(config, folder / "out").prepare()
    return Placement.load(folder / "out" / "placement.json")


def test_a_board_makes_a_run_metric(photos, cameras, tmp_path):
    placement = placed(photos, cameras, tmp_path, board=BOARD)
    assert placement.alignment is not None
    assert (placement.alignment.metric, placement.alignment.located) == (True, False)
    wrong = np.log(placement.alignment.target_from_source.scale * SCALE)
    assert abs(wrong) < 0.01
    assert abs(wrong) < 4 * placement.alignment.scale_sigma
    trajectory = Trajectory.load(tmp_path / "out" / "trajectory.json")
    assert trajectory.metric
    there, here = trajectory.centers_in_world, cameras.centers_in_world
    spans = (np.linalg.norm(centers[7] - centers[0]) for centers in (there, here))
    assert next(spans) == pytest.approx(next(spans), rel=0.01)


def test_a_distance_makes_a_run_metric(photos, cameras, tmp_path):
    file = write_distance(tmp_path / "distance.json", cameras)
    placement = placed(photos, cameras, tmp_path, distance=file)
    assert placement.alignment is not None
    assert placement.alignment.target_from_source.scale * SCALE == pytest.approx(1, rel=1e-4)
    assert placement.describe() == "metric by drum to valve"
    # 1 cm of 1.42 m, and the clicks
    assert placement.alignment.scale_sigma == pytest.approx(0.0075, rel=0.25)


def test_two_lengths_that_contradict_each_other_are_refused(photos, cameras, tmp_path):
    file = write_distance(tmp_path / "distance.json", cameras, distance_m=1.0)
    with pytest.raises(BadInputError, match=r"valve|board"):
        placed(photos, cameras, tmp_path, distance=file, board=BOARD)


@pytest.mark.parametrize(
    "text", ["4X4_50", "4X4_50:0", "4X4_50:x", "nothing:0.1", "4X4_50:0.1:0x2", "4X4_50:1.2.3"]
)
def test_a_wrong_board_is_told_before_any_work(photos, tmp_path, text):
    command = ["run", str(photos), "-o", str(tmp_path / "out"), "--board", text]
    ended = CliRunner().invoke(app, command)
    assert isinstance(ended.exception, BadInputError)
    assert "board" in str(ended.exception)
    assert not (tmp_path / "out" / "frames").exists()


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"distance_m": -1}, "distance_m"),
        ({"points": {"a": {"1.png": [1, 2], "2.png": [1, 2]}}}, "points"),
        ({"points": {"a": {"1.png": [1, 2]}, "b": {"1.png": [1, 2]}}}, "points.a"),
        ({"sigma": 1}, "sigma"),
    ],
)
def test_a_wrong_distance_is_told_before_any_work(photos, cameras, tmp_path, change, line):
    file = write_distance(tmp_path / "distance.json", cameras, **change)
    command = ["run", str(photos), "-o", str(tmp_path / "out"), "--distance", str(file)]
    ended = CliRunner().invoke(app, command)
    assert isinstance(ended.exception, BadInputError)
    assert line in str(ended.exception)
    assert not (tmp_path / "out" / "frames").exists()


def test_clicks_in_frames_that_are_not_there(cameras, tmp_path):
    clicks = {"000000.png": [3.0, 4.0], "999.png": [5.0, 6.0]}
    points = {"drum": clicks, "valve": clicks}
    known = KnownDistance.load(write_distance(tmp_path / "d.json", cameras, points=points))
    with pytest.raises(BadInputError, match=r"drum: .* two frames .*999\.png"):
        known.constrain_scale(cameras, {f"{row:06d}.png": row for row in range(8)})


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(BadInputError, match="cannot be read"):
        KnownLengths.of(None, tmp_path / "none.json")


def test_a_board_is_named_by_its_print():
    board, same = parse_board("APRILTAG_36h11:0.1:3x2:0.02"), marker_board(
        "APRILTAG_36h11", columns=3, rows=2, size_m=0.1, gap_m=0.02
    )  # fmt: skip
    assert np.array_equal(np.array(board.getObjPoints()), np.array(same.getObjPoints()))
    assert len(parse_board("4X4_50:0.15").getIds()) == 1
