"""`locate calibrate` on pictures of a board, as a user types it."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from geometry.errors import BadInputError
from geometry.named_poses import read_camera
from locate.commands.app import app

FOCAL_PX = 300.0
SIZE = (320, 240)


def board_photos(folder: Path, count: int) -> Path:
    """A chessboard of 7x5 inner corners, each photo from another side and place."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    fields = (np.indices((6, 8)).sum(axis=0) % 2 * 200 + 20).astype(np.uint8)
    page = np.pad(fields.repeat(40, axis=0).repeat(40, axis=1), 40, constant_values=220)
    matrix = np.array([[FOCAL_PX, 0, 159.5], [0, FOCAL_PX, 119.5], [0, 0, 1]])
    to_fields = np.array([[1 / 40, 0, -5], [0, 1 / 40, -4], [0, 0, 1.0]])
    for i in range(count):
        turn = cv2.Rodrigues(np.array([*rng.uniform(-0.45, 0.45, 2), rng.uniform(-0.3, 0.3)]))[0]
        aim = np.array([(i % 3 - 1) * 2.2, (i // 3 % 3 - 1) * 1.5, 15.0])
        placed = matrix @ np.column_stack([turn[:, 0], turn[:, 1], aim]) @ to_fields
        large = np.diag([4.0, 4.0, 1.0]) @ placed
        seen = cv2.warpPerspective(page, large, (1280, 960), borderValue=120)
        photo = cv2.resize(seen, SIZE, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(folder / f"b{i:02d}.png"), photo)
    return folder


def test_a_board_becomes_a_camera_file(tmp_path: Path) -> None:
    photos, output = board_photos(tmp_path / "board", 12), tmp_path / "mine" / "camera.json"
    told = CliRunner().invoke(
        app, ["calibrate", str(photos), "--board", "7x5", "-o", str(output), "--lens", "pinhole"]
    )
    assert told.exit_code == 0, told.output
    assert "pinhole, focal length" in told.output
    camera = read_camera(output, *SIZE)
    assert camera.focal_px == pytest.approx(FOCAL_PX, rel=0.02)
    content = json.loads(output.read_text())
    assert content["schema"] == "locate.camera/1"
    assert content["calibration"]["others_px"] < 0.5
    picture = cv2.imread(str(output.with_suffix(".png")))
    assert picture is not None
    assert picture.shape == (240, 320, 3)


def test_too_little_of_the_board_is_refused(tmp_path: Path) -> None:
    photos = board_photos(tmp_path / "board", 3)
    command = ["calibrate", str(photos), "--board", "7x5", "-o", str(tmp_path / "c.json")]
    with pytest.raises(BadInputError, match=r"board: the board is seen in 3 pictures"):
        CliRunner().invoke(app, command, catch_exceptions=False)
