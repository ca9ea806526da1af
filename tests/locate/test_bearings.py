import cv2
import numpy as np

from detect.detection import Detection
from geometry.camera import Camera
from locate.fusion.bearings import find_bearings

CAMERA = Camera.pinhole(160, 120, 150.0)


def detection(rng: np.random.Generator, plume: bool) -> Detection:
    llr = rng.normal(-0.4, 0.5, (120, 160)).astype(np.float32)
    if plume:
        axes = (6 + int(rng.integers(3)), 25)
        cv2.ellipse(llr, (100 + int(rng.integers(-3, 4)), 60), axes, 0, 0, 360, 2.0, -1)
    llr = cv2.GaussianBlur(llr, (0, 0), 1.5)
    displacement = np.zeros((120, 160, 2), np.float32)
    displacement[..., 0] = np.maximum(llr, 0)
    return Detection(displacement=displacement, sigma_px=np.ones_like(llr), llr=llr)


def test_plume_before_a_still_camera_gives_the_direction_of_its_base() -> None:
    rng = np.random.default_rng(0)
    (bearing,) = find_bearings([detection(rng, True) for _ in range(10)], CAMERA)
    x, y = CAMERA.project(bearing.direction_in_cam)
    assert abs(x - 100) < 4
    assert 75 < y < 92
    assert bearing.probability > 0.99
    assert 0 < bearing.sigma_rad < 0.1


def test_noise_alone_gives_no_direction() -> None:
    rng = np.random.default_rng(1)
    assert find_bearings([detection(rng, False) for _ in range(10)], CAMERA) == ()
