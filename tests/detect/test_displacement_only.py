import cv2
import numpy as np
import pytest

from detect.detection import Detection, Frames
from detect.registered import DisplacementOnlyDetector, RegisteredDetector, displacement_only
from detect.registered.displacement_only import halve_frames
from detect.registry import make_displacement_only
from geometry.errors import BadInputError
from tests.detect.scenes import TwoWalls, two_walls


@pytest.fixture(scope="module")
def scene() -> TwoWalls:
    return two_walls(peak_px=0.3)


def size_px(detection: Detection, displacement: np.ndarray) -> float:
    """The largest displacement, of one of that shape, by least squares."""
    information = detection.information
    assert information is not None
    height, width = information.matrix.shape[:2]
    x, y = np.moveaxis(cv2.resize(displacement, (width, height)), -1, 0)
    vector, (xx, xy, yy) = information.vector, np.moveaxis(information.matrix, -1, 0)
    score = (x * vector[..., 0] + y * vector[..., 1]).sum()
    share = score / (x * x * xx + 2 * x * y * xy + y * y * yy).sum()
    return float(share * np.linalg.norm(displacement, axis=-1).max())


@pytest.mark.parametrize("halved", [False, True])
def test_the_displacement_is_that_of_the_whole_detection(
    scene: TwoWalls, halved: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if halved:
        monkeypatch.setattr(displacement_only, "MAP_WIDTH_PX", 80)
    alone = DisplacementOnlyDetector().detect(scene.frames, scene.key)
    whole = RegisteredDetector().detect(scene.frames, scene.key)
    measured_px = size_px(whole, scene.displacement)
    assert measured_px > 0.03
    assert size_px(alone, scene.displacement) == pytest.approx(measured_px, rel=0.1)
    assert alone.llr.shape == ((60, 80) if halved else (120, 160))


def test_no_pixel_has_evidence_and_the_depth_is_known(scene: TwoWalls) -> None:
    alone = DisplacementOnlyDetector().detect(scene.frames, scene.key)
    assert not alone.llr.any()
    assert np.isinf(alone.sigma_px).all()
    assert alone.inverse_depth is not None
    assert np.nanmedian(alone.inverse_depth * scene.depth) == pytest.approx(1, rel=0.02)


def test_a_frame_without_neighbours_tells_nothing(scene: TwoWalls) -> None:
    trajectory = scene.frames.trajectory
    assert trajectory is not None
    pair = Frames(images=scene.frames.images[:2], trajectory=trajectory.take([0, 1]))
    alone = DisplacementOnlyDetector().detect(pair, 0)
    assert alone.information is None


def test_halved_frames_keep_all_pixels_beside_them(scene: TwoWalls) -> None:
    trajectory = scene.frames.trajectory
    assert trajectory is not None
    half = halve_frames(scene.frames, trajectory)
    assert half.full_size is not None
    assert half.trajectory is not None
    assert half.images[3].shape == (60, 80)
    assert [image.shape for image in half.images[2:4]] == [(60, 80)] * 2
    np.testing.assert_array_equal(half.full_size[3], scene.frames.images[3])
    assert half.trajectory.camera.focal_px == pytest.approx(trajectory.camera.focal_px / 2)


def test_a_detector_that_measures_no_displacement_is_refused() -> None:
    with pytest.raises(BadInputError, match="bos measures no displacement"):
        make_displacement_only("bos")
