import numpy as np
import pytest

from detect.bos import mean_reference, texture_of, unbiased_flow
from detect.bos_checks import FrameCheck, RecordingFault, reference_fault
from detect.differential import horn_schunck
from geometry.arrays import GreyImage
from tests.detect.scenes import Texture, photographed, ring_displacement

SHAPE = (128, 192)
TEXTURE = Texture(4, 1.2)
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
LENS = ring_displacement(SHAPE, 0.4, 14.0)


def seen(w: np.ndarray, seed: int) -> GreyImage:
    return photographed(TEXTURE(X + w[..., 0], Y + w[..., 1]), seed=seed)


REFERENCE = mean_reference([seen(0 * LENS, 100 + k) for k in range(10)])


def checked(image: GreyImage) -> FrameCheck:
    texture = texture_of(REFERENCE)
    flow, bias_px = unbiased_flow(horn_schunck, REFERENCE, image, texture)
    return FrameCheck.compare(REFERENCE, image, flow, bias_px, texture)


def turned(degrees: float) -> np.ndarray:
    turn = np.deg2rad(degrees)
    return turn * np.stack([SHAPE[0] / 2 - Y, X - SHAPE[1] / 2], axis=-1)


@pytest.mark.parametrize("shake_px", [(0.0, 0.0), (0.2, -0.15)])
def test_a_plume_and_a_vibration_are_no_fault(shake_px: tuple[float, float]) -> None:
    check = checked(seen(LENS + shake_px, seed=1))
    assert check.fault is None
    assert np.abs(np.subtract(check.shift_px, shake_px)).max() < 0.03


def test_brightness_of_the_whole_frame_is_told() -> None:
    image = seen(LENS, seed=1)
    brighter = np.rint(image * 1.02).clip(0, 255).astype(np.uint8)
    assert checked(brighter).light == pytest.approx(0.02, abs=0.002)
    assert checked(brighter).fault is RecordingFault.LIGHT


def test_a_shadow_over_one_half_is_told() -> None:
    image = seen(LENS, seed=1).astype(float)
    image[:, : SHAPE[1] // 2] *= 0.97
    assert checked(np.rint(image).astype(np.uint8)).fault is RecordingFault.LIGHT


@pytest.mark.parametrize("moved", [np.array([1.3, 0.2]), turned(0.12), 0.002 * np.dstack([X, Y])])
def test_a_camera_that_moved_is_told(moved: np.ndarray) -> None:
    assert checked(seen(LENS + moved, seed=1)).fault is RecordingFault.MOVED


def test_a_turn_too_small_to_matter_passes() -> None:
    assert checked(seen(LENS + turned(0.02), seed=1)).fault is None


def test_something_that_came_into_view_is_told() -> None:
    image = seen(LENS, seed=1)
    image[30:90, 70:125] = 60
    assert checked(image).fault is RecordingFault.INTRUDED


def test_a_good_reference_has_no_fault() -> None:
    images = [seen(0 * LENS + shift, k) for k, shift in enumerate(np.linspace(-0.1, 0.1, 9))]
    assert reference_fault(mean_reference(images), images) is None


def test_a_plume_that_sways_in_the_reference_is_told() -> None:
    rng = np.random.default_rng(0)
    images = [seen(LENS * rng.uniform(-1, 1), k) for k in range(9)]
    assert reference_fault(mean_reference(images), images) is RecordingFault.PLUME


def test_an_overexposed_reference_is_told() -> None:
    bright = np.minimum(REFERENCE.astype(int) * 2, 255).astype(np.uint8)
    assert reference_fault(bright) is RecordingFault.CLIPPED


def test_a_blank_wall_is_told() -> None:
    wall = photographed(np.full(SHAPE, 120.0), seed=0, noise=0.3)
    assert reference_fault(wall) is RecordingFault.BLANK
