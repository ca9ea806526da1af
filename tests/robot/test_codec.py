import array
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from geometry.errors import BadInputError
from locate.messages.camera_info import camera_from_info
from locate.messages.codec import GreyReader, read_stamp_ns
from tests.robot.fake_messages import camera_info, header, image

RNG = np.random.default_rng(0)
GREY = RNG.integers(0, 256, (6, 10), dtype=np.uint8)
COLOURS = RNG.integers(0, 256, (6, 10, 3), dtype=np.uint8)
DEEP = RNG.integers(0, 4096, (6, 10), dtype=np.uint16)
DEEP[0, 0] = 4095


def read(message: Any) -> np.ndarray:
    return GreyReader().read(message)


@pytest.mark.parametrize("padding", [0, 1, 7])
@pytest.mark.parametrize("big", [False, True])
def test_padding_and_byte_order_change_nothing(padding: int, big: bool) -> None:
    np.testing.assert_array_equal(read(image(GREY, "mono8", padding=padding, big=big)), GREY)
    deep = read(image(DEEP, "mono16", padding=padding, big=big))
    np.testing.assert_array_equal(deep, DEEP >> 4)
    grey = read(image(COLOURS, "bgr8", padding=padding, big=big))
    np.testing.assert_array_equal(grey, cv2.cvtColor(COLOURS, cv2.COLOR_BGR2GRAY))


@pytest.mark.parametrize(
    ("encoding", "order"), [("bgr8", [0, 1, 2]), ("rgb8", [2, 1, 0]), ("8UC3", [0, 1, 2])]
)
def test_colour_orders_agree(encoding: str, order: list[int]) -> None:
    expected = cv2.cvtColor(COLOURS, cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(read(image(COLOURS[..., order], encoding)), expected)


@pytest.mark.parametrize(("encoding", "order"), [("bgra8", [0, 1, 2, 3]), ("rgba8", [2, 1, 0, 3])])
def test_alpha_is_ignored(encoding: str, order: list[int]) -> None:
    with_alpha = np.dstack([COLOURS, RNG.integers(0, 256, (6, 10), dtype=np.uint8)])
    expected = cv2.cvtColor(COLOURS, cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(read(image(with_alpha[..., order], encoding)), expected)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("bits", [8, 16])
def test_mosaic_gives_the_grey_of_its_colour(pattern: str, bits: int) -> None:
    bgr = {"r": 200, "g": 100, "b": 20}
    tile = np.array([bgr[letter] for letter in pattern], np.uint8).reshape(2, 2)
    mosaic = np.tile(tile, (6, 8))
    message = image(
        mosaic.astype(np.uint16) << 8 if bits == 16 else mosaic, f"bayer_{pattern}{bits}"
    )
    grey = read(message)[2:-2, 2:-2]
    assert np.abs(grey.astype(int) - (0.299 * 200 + 0.587 * 100 + 0.114 * 20)).max() <= 1


@pytest.mark.parametrize(("encoding", "place"), [("yuyv", 0), ("uyvy", 1), ("yuv422", 1)])
def test_luma_is_the_grey(encoding: str, place: int) -> None:
    pairs = np.full((6, 10, 2), 128, np.uint8)
    pairs[..., place] = GREY
    np.testing.assert_array_equal(read(image(pairs, encoding, padding=3)), GREY)


def test_depth_never_flickers() -> None:
    reader = GreyReader()
    bright = reader.read(image(DEEP, "mono16"))
    dark = reader.read(image(DEEP // 8, "mono16"))
    np.testing.assert_array_equal(bright, DEEP >> 4)
    np.testing.assert_array_equal(dark, DEEP // 8 >> 4)


def test_live_thermal_images_keep_their_levels() -> None:
    reader = GreyReader()
    thermal = (29000 + DEEP // 4).astype(np.uint16)
    plain = reader.read(image(np.full_like(thermal, 29000), "16UC1"))
    assert np.ptp(plain) == 0
    first, warmer = reader.read(image(thermal, "16UC1")), reader.read(image(thermal + 20, "16UC1"))
    assert len(np.unique(first)) > 40
    assert 0 < np.median(warmer.astype(int) - first) < 10
    hot = reader.read(image(thermal + 2000, "16UC1"))
    assert len(np.unique(hot)) > 20


@pytest.mark.parametrize("kind", [bytes, bytearray, list, lambda b: array.array("B", b)])
def test_data_may_be_of_any_kind(kind: object) -> None:
    message = image(GREY, "mono8")
    message.data = kind(message.data)  # type: ignore[operator]
    np.testing.assert_array_equal(read(message), GREY)


@pytest.mark.parametrize(
    ("suffix", "name"), [(".png", "png"), (".jpg", "bgr8; jpeg compressed bgr8")]
)
def test_compressed_images_are_read(suffix: str, name: str) -> None:
    smooth = cv2.resize(COLOURS, (64, 48), interpolation=cv2.INTER_CUBIC)
    data = cv2.imencode(suffix, smooth)[1].tobytes()
    grey = read(SimpleNamespace(header=header(), format=name, data=data))
    expected = cv2.cvtColor(smooth, cv2.COLOR_BGR2GRAY)
    assert np.abs(grey.astype(int) - expected).mean() < 3


@pytest.mark.parametrize(
    "changes",
    [
        {"encoding": "32FC1"},
        {"encoding": ""},
        {"width": 0},
        {"height": -1},
        {"width": 1 << 31, "height": 1 << 31},
        {"step": 9},
        {"data": b""},
        {"data": bytes(55)},
        {"height": 1000},
        {"encoding": "bgr8"},
        {"encoding": "mono16"},
    ],
)
def test_what_the_header_does_not_describe_is_refused(changes: dict[str, object]) -> None:
    message = image(GREY, "mono8")
    vars(message).update(changes)
    with pytest.raises(BadInputError):
        read(message)


@pytest.mark.parametrize("data", [b"", b"\xff\xd8 not a jpeg", bytes(1000)])
def test_broken_compressed_images_are_refused(data: bytes) -> None:
    with pytest.raises(BadInputError):
        read(SimpleNamespace(header=header(), format="jpeg", data=data))


def test_thousand_random_messages_are_read_or_refused() -> None:
    rng = np.random.default_rng(1)
    encodings = ["mono8", "mono16", "rgb8", "bayer_rggb8", "yuv422", "8UC4", "no"]
    refused = 0
    for _ in range(1000):
        message = SimpleNamespace(
            header=header(),
            height=int(rng.integers(-1, 9)),
            width=int(rng.integers(-1, 9)),
            encoding=str(rng.choice(encodings)),
            is_bigendian=int(rng.integers(0, 256)),
            step=int(rng.integers(0, 40)),
            data=rng.bytes(int(rng.integers(0, 300))),
        )
        try:
            assert read(message).shape == (message.height, message.width)
        except BadInputError:
            refused += 1
    assert 300 < refused < 1000


def test_camera_info_of_an_ideal_lens() -> None:
    camera = camera_from_info(camera_info())
    assert (camera.model, camera.width, camera.height) == ("PINHOLE", 640, 480)
    assert camera.params == (500, 510, 320, 240)


@pytest.mark.parametrize("name", ["", "none", "plumb_bob", "rational_polynomial"])
@pytest.mark.parametrize("count", [0, 5, 14])
def test_no_coefficients_are_an_ideal_lens(name: str, count: int) -> None:
    camera = camera_from_info(camera_info(distortion_model=name, d=[0.0] * count))
    assert camera.model == "PINHOLE"


def test_rectified_images_have_the_projection_matrix() -> None:
    camera = camera_from_info(camera_info(d=[0.1, 0, 0, 0, 0]), rectified=True)
    assert camera.params == (480, 480, 310, 230)


@pytest.mark.parametrize(
    ("name", "d"),
    [
        ("plumb_bob", [-0.2, 0.05, 0.001, -0.002, 0.0]),
        ("plumb_bob", [-0.2, 0.05, 0.001, -0.002, 0.03]),
        ("rational_polynomial", [0.1, -0.1, 0.001, 0.002, 0.01, 0.2, -0.05, 0.01]),
    ],
)
def test_distortion_is_opencvs(name: str, d: list[float]) -> None:
    message = camera_info(distortion_model=name, d=d)
    points = np.array([[0.1, 0.2, 1.0], [-0.3, 0.25, 1.0], [0.0, 0.0, 2.0]])
    matrix = np.array(message.k).reshape(3, 3)
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(d))[0]
    projected = camera_from_info(message).project(points)
    np.testing.assert_allclose(projected, expected[:, 0], atol=1e-6)


@pytest.mark.parametrize("name", ["equidistant", "fisheye", "kannala_brandt4"])
@pytest.mark.parametrize("d", [[0.05, -0.01, 0.002, 0.001], [0.0] * 4])
def test_fisheye_is_opencvs(name: str, d: list[float]) -> None:
    message = camera_info(distortion_model=name, d=d)
    points = np.array([[0.5, 0.2, 1.0], [-0.9, 0.25, 1.0]])
    matrix = np.array(message.k).reshape(3, 3)
    expected = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), matrix, np.array(d)
    )[0]
    projected = camera_from_info(message).project(points)
    np.testing.assert_allclose(projected, expected[:, 0], atol=1e-6)


def test_binning_and_region_of_interest_move_the_camera() -> None:
    roi = SimpleNamespace(x_offset=100, y_offset=40, width=400, height=300)
    camera = camera_from_info(camera_info(binning_x=2, binning_y=2, roi=roi))
    assert (camera.width, camera.height) == (200, 150)
    full = camera_from_info(camera_info())
    point = np.array([0.1, -0.05, 1.0])
    expected = (full.project(point) - [100, 40] + 0.5) / 2 - 0.5
    np.testing.assert_allclose(camera.project(point), expected)


def test_camera_info_of_ros_1_is_read() -> None:
    message = camera_info()
    for name in "dkp":
        setattr(message, name.upper(), vars(message).pop(name))
    assert camera_from_info(message).params == (500, 510, 320, 240)


@pytest.mark.parametrize(
    "changes",
    [
        {"k": [0.0] * 9},
        {"k": [np.nan] * 9},
        {"width": 0},
        {"distortion_model": "thin_prism", "d": [0.1]},
        {"distortion_model": "thin_prism", "d": [0.0] * 4},
        {"distortion_model": "", "d": [0.1, 0, 0, 0]},
        {"distortion_model": "plumb_bob", "d": [0.1]},
        {"distortion_model": "plumb_bob", "d": [-0.1, 0.01, 0, 0, 0, 0.01, 0.01, 0.01]},
        {"distortion_model": "rational_polynomial", "d": [0.1] * 12},
        {"distortion_model": "equidistant", "d": [0.1] * 8},
        {"distortion_model": "equidistant", "d": []},
        {"k": [500.0, 2.0, 320, 0, 510, 240, 0, 0, 1]},
    ],
)
def test_cameras_that_are_not_understood_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(BadInputError):
        camera_from_info(camera_info(**changes))


def test_stamps_of_both_generations() -> None:
    assert read_stamp_ns(header(1_700_000_000_123_456_789)) == 1_700_000_000_123_456_789
    old = SimpleNamespace(stamp=SimpleNamespace(secs=5, nsecs=7), frame_id="")
    assert read_stamp_ns(old) == 5_000_000_007
