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
from locate.commands.app import app
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
ENDS_M = {"drum": np.array([-0.4, -0.2, 0.0]), "valve": np.array([0.5, -0.6, 0.0])}


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
    # 1 cm of 0.98 m, and the clicks
    assert placement.alignment.scale_sigma == pytest.approx(0.011, rel=0.25)


def test_two_lengths_that_contradict_each_other_are_refused(photos, cameras, tmp_path):
    file = write_distance(tmp_path / "distance.json", cameras, distance_m=0.7)
    with pytest.raises(BadInputError, match=r"valve|board"):
        placed(photos, cameras, tmp_path, distance=file, board=BOARD)


@pytest.mark.parametrize(
    "text",
    [
        "4X4_50",
        "4X4_50:0",
        "4X4_50:x",
        "nothing:0.1",
        "4X4_50:0.1:0x2",
        "4X4_50:1.2.3",
        "4X4_50:0.1:8x7",
        "4X4_50:0.1:99999x99999",
        "4X4_50:0.1:99999999999x2",
    ],
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


ROWS = {f"{row:06d}.png": row for row in range(8)}


def known_distance(
    cameras: Trajectory, folder: Path, off_px: dict[str, tuple[float, float]], **changes: object
) -> KnownDistance:
    """The true distance, the clicks on the drum off by that much."""
    path = write_distance(folder / "distance.json", cameras, **changes)
    content = json.loads(path.read_text())
    drum = content["points"]["drum"]
    for frame, (x, y) in off_px.items():
        drum[frame] = [drum[frame][0] + x, drum[frame][1] + y]
    path.write_text(json.dumps(content))
    return KnownDistance.load(path)


@pytest.mark.parametrize("off_px", [(900, 0), (0, -700), (-900, 0), (0, 900)])
def test_a_click_outside_its_frame_is_refused(cameras, tmp_path, off_px):
    known = known_distance(cameras, tmp_path, {"000003.png": off_px})
    line = r"drum: the click at .* px is outside 000003\.png, which is 640x480 px"
    with pytest.raises(BadInputError, match=line):
        known.constrain_scale(cameras, ROWS)


@pytest.mark.parametrize("frame", ["000000.png", "000006.png"])
def test_clicks_on_no_common_point_are_refused(cameras, tmp_path, frame):
    known = known_distance(cameras, tmp_path, {frame: (25, -25)})
    line = rf"drum: .*no common point: .*{frame} \d+\.\d px.*sigma_px is 1;"
    with pytest.raises(BadInputError, match=line):
        known.constrain_scale(cameras, ROWS)
    # With such clicks it is no contradiction, and the scale is not known to 1 %.
    blunt = known_distance(cameras, tmp_path, {frame: (25, -25)}, sigma_px=20.0)
    scale = blunt.constrain_scale(cameras, ROWS)
    assert scale.sigma_log > 0.03


def test_two_clicks_on_no_common_point_are_refused(cameras, tmp_path):
    file = write_distance(tmp_path / "distance.json", cameras)
    points = json.loads(file.read_text())["points"]
    del points["drum"]["000006.png"]
    points["drum"]["000003.png"][1] += 30
    known = known_distance(cameras, tmp_path, {}, points=points)
    with pytest.raises(BadInputError, match=r"drum: .*no common point"):
        known.constrain_scale(cameras, ROWS)


def test_lines_of_sight_that_part_are_refused(cameras, tmp_path):
    points = {
        "drum": {"000000.png": [5.0, 200.0], "000003.png": [635.0, 200.0]},
        "valve": {"000000.png": [300.0, 200.0], "000003.png": [200.0, 200.0]},
    }
    known = known_distance(cameras, tmp_path, {}, points=points)
    with pytest.raises(BadInputError, match=r"drum: .*no common point: .*behind"):
        known.constrain_scale(cameras, ROWS)


def test_clicks_that_are_a_little_off_count_for_less(cameras, tmp_path):
    exact = known_distance(cameras, tmp_path, {}).constrain_scale(cameras, ROWS)
    off = {"000000.png": (3.0, 3.0), "000006.png": (-3.0, -3.0)}
    blurred = known_distance(cameras, tmp_path, off).constrain_scale(cameras, ROWS)
    assert blurred.sigma_log > exact.sigma_log
    wrong = np.log(blurred.metres_per_unit)
    assert abs(wrong) < 3 * blurred.sigma_log


def test_clicks_in_no_frame_of_the_run_are_refused(photos, cameras, tmp_path):
    file = write_distance(tmp_path / "distance.json", cameras)
    content = json.loads(file.read_text())
    content["points"]["valve"]["IMG_1.png"] = [3.0, 4.0]
    file.write_text(json.dumps(content))
    with pytest.raises(BadInputError, match=r"valve in IMG_1\.png: no such image"):
        placed(photos, cameras, tmp_path, distance=file)


def test_clicks_in_frames_without_a_pose_are_noted(photos, cameras, tmp_path):
    file = write_distance(tmp_path / "distance.json", cameras)
    lengths = KnownLengths.of(None, file)
    names = [name for name in ROWS if name != "000003.png"]
    scene = cameras.take([row for row in range(8) if row != 3])
    (scale,) = lengths.constrain_scale(scene, photos, names)
    assert scale.metres_per_unit == pytest.approx(1, rel=1e-4)
    (note,) = lengths.describe_unused(names)
    assert "drum in 000003.png, valve in 000003.png" in note
    assert lengths.describe_unused(list(ROWS)) == ()


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(BadInputError, match="cannot be read"):
        KnownLengths.of(None, tmp_path / "none.json")


def test_a_board_is_named_by_its_print():
    board, same = parse_board("APRILTAG_36h11:0.1:3x2:0.02"), marker_board(
        "APRILTAG_36h11", columns=3, rows=2, size_m=0.1, gap_m=0.02
    )  # fmt: skip
    assert np.array_equal(np.array(board.getObjPoints()), np.array(same.getObjPoints()))
    assert len(parse_board("4X4_50:0.15").getIds()) == 1
