"""Lenses from boards: the camera that put the corners there comes back, or a reason."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.calibration_board import CalibrationBoard
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.lens_calibration import BoardView, LensName, calibrate_lens

SIZE = (640, 480)
NOISE_PX = 0.05
CAMERAS: dict[LensName, Camera] = {
    "pinhole": Camera(model="PINHOLE", width=640, height=480, params=(500.0, 503.0, 322.0, 236.0)),
    "radial": Camera(
        model="OPENCV", width=640, height=480, params=(500, 503, 322, 236, -0.25, 0.08, 0, 0)
    ),
    "fisheye": Camera(
        model="OPENCV_FISHEYE", width=640, height=480,
        params=(360, 362, 322, 236, 0.03, -0.02, 0.01, -0.002),
    ),
}  # fmt: skip


def boards(
    camera: Camera, *, count: int = 16, spread: float = 1.0, noise_px: float = NOISE_PX
) -> list[BoardView]:
    """A board of 9x6 corners, a field 3 cm wide, from all sides and in all parts of the image."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:6, :9]
    on_board = np.column_stack([x.ravel(), y.ravel()]).astype(float)
    flat = np.pad(on_board - on_board.mean(axis=0), ((0, 0), (0, 1)))
    views: list[BoardView] = []
    while len(views) < count:
        aim = camera.rays(rng.uniform(0.2, 0.8, (1, 2)) * (640, 480))[0]
        aim = np.array([0, 0, 1.0]) + spread * (aim / aim[2] - [0, 0, 1])
        turn = Rotation.from_euler("xyz", rng.uniform(-0.5, 0.5, 3) * (1, 1, 2))
        in_cam = turn.apply(flat) + rng.uniform(13, 18) * aim
        in_image = camera.project(in_cam) + rng.normal(0, noise_px, (54, 2))
        if ((in_image > 0) & (in_image < SIZE)).all():
            views.append(BoardView(name=f"{len(views)}", on_board=on_board, in_image=in_image))
    return views


@pytest.mark.parametrize("lens", CAMERAS)
def test_the_lens_is_found_and_the_simplest_that_explains_it(lens: LensName) -> None:
    camera = CAMERAS[lens]
    found = calibrate_lens(boards(camera), SIZE)
    assert found.lens == lens
    assert found.rms_px == pytest.approx(NOISE_PX * np.sqrt(2), rel=0.2)
    assert found.camera.focal_px == pytest.approx(camera.focal_px, rel=0.005)
    pixels = np.random.default_rng(1).uniform((80, 60), (560, 420), (40, 2))
    apart = found.camera.project(camera.rays(pixels)) - pixels
    assert np.abs(apart).max() < 1.0


def test_a_lens_can_be_asked_for() -> None:
    assert calibrate_lens(boards(CAMERAS["pinhole"]), SIZE, "radial").camera.model == "OPENCV"


def corner_of(view: BoardView) -> BoardView:
    """Only 4x3 of its corners."""
    kept = (view.on_board < (4, 3)).all(axis=1)
    return BoardView(name=view.name, on_board=view.on_board[kept], in_image=view.in_image[kept])


def test_what_does_not_suffice_is_refused() -> None:
    camera = CAMERAS["pinhole"]
    with pytest.raises(BadInputError, match="seen in 5 pictures"):
        calibrate_lens(boards(camera, count=5), SIZE)
    with pytest.raises(BadInputError, match="covers"):
        calibrate_lens([corner_of(view) for view in boards(camera, spread=0.02)], SIZE)
    blurred = boards(camera, noise_px=3.0)
    with pytest.raises(BadInputError, match="px off"):
        calibrate_lens(blurred, SIZE, "pinhole")


def test_a_lens_that_sees_too_much_is_named() -> None:
    wide = Camera(
        model="OPENCV_FISHEYE", width=640, height=480, params=(280, 280, 322, 236, 0, 0, 0, 0)
    )
    with pytest.raises(BadInputError, match="beyond 120 degrees"):
        calibrate_lens(boards(wide), SIZE, "fisheye")


def drawn(board: FloatArray, camera: Camera) -> np.ndarray:
    """A picture of the board turned a little, 12 fields of it before the camera."""
    matrix = np.array([[500, 0, 322.0], [0, 503, 236], [0, 0, 1]])
    turn = Rotation.from_euler("xyz", [0.2, -0.15, 0.1]).as_matrix()
    px = board.shape[1] / 11
    to_fields = np.array([[1 / px, 0, -5.5], [0, 1 / px, -4], [0, 0, 1.0]])
    plane = np.column_stack([turn[:, 0], turn[:, 1], [0, 0, 16.0]])
    placed = cv2.warpPerspective(
        board, matrix @ plane @ to_fields, (camera.width, camera.height), flags=cv2.INTER_AREA,
        borderValue=255,
    )  # fmt: skip
    return np.asarray(placed)


def test_the_corners_of_a_chessboard_are_found() -> None:
    fields = np.indices((7, 10)).sum(axis=0) % 2 * 255
    page = np.pad(fields, ((0, 0), (0, 0))).astype(np.uint8).repeat(60, axis=0).repeat(60, axis=1)
    page = np.pad(page, 60, constant_values=255)[:, :660]
    page = np.pad(page, ((0, 0), (0, 60)), constant_values=255)
    picture = drawn(page, CAMERAS["pinhole"])
    found = CalibrationBoard.parse("9x6").find(picture)
    assert found is not None
    assert found.in_image.shape == found.on_board.shape == (54, 2)
    assert CalibrationBoard.parse("9x6").find(np.full((480, 640), 90, np.uint8)) is None


def test_the_corners_of_a_charuco_board_are_found() -> None:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    page = cv2.aruco.CharucoBoard((7, 5), 1.0, 0.75, dictionary).generateImage((700, 500))
    page = np.pad(page, 60, constant_values=255)
    found = CalibrationBoard.parse("charuco:4x4_50:7x5").find(page)
    assert found is not None
    assert len(found.on_board) == 24
    order = np.lexsort(found.on_board.T)
    places, seen = found.on_board[order], found.in_image[order]
    np.testing.assert_allclose(seen - seen[0], 100 * (places - places[0]), atol=0.5)


@pytest.mark.parametrize(
    "text",
    ["", "9", "9x2", "charuco:9x6", "charuco:NONE:7x5", "0x0", "charuco:4X4_50:99x99"],
)
def test_what_describes_no_board_is_refused(text: str) -> None:
    with pytest.raises(BadInputError, match="--board"):
        CalibrationBoard.parse(text)
