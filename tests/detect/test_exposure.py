"""Frames of different exposure are compared as if they were of the same."""

from dataclasses import replace

import numpy as np
import pytest

from detect.detection import Frames
from detect.registered import RegisteredDetector
from detect.registered.exposure import brighten, brighten_full_size, gain_towards
from geometry.arrays import GreyImage
from geometry.epipolar import EpipolarGeometry
from tests.detect.scenes import TwoWalls

FAR = 12.0
"""Depth of most of the scene."""
GAINS = np.exp(np.random.default_rng(0).normal(0, 0.1, 13))


def gain_in(scene: TwoWalls, image: GreyImage, row: int) -> float:
    """Towards the key frame, of an image taken where a row of the scene was."""
    trajectory = scene.frames.trajectory
    assert trajectory is not None
    view = EpipolarGeometry.between_frames(trajectory, scene.key, row).in_unit(1 / FAR)
    return gain_towards(scene.frames.images[scene.key], image, view)


def with_drifting_exposure(scene: TwoWalls) -> Frames:
    images = [
        np.clip(np.rint(image * gain), 0, 255).astype(np.uint8)
        for image, gain in zip(scene.frames.images, GAINS / GAINS[scene.key], strict=True)
    ]
    return replace(scene.frames, images=images)


@pytest.mark.parametrize("gain", [0.6, 0.9, 1.02, 1.3])
@pytest.mark.parametrize("row", [5, 7, 9])
def test_the_gain_between_frames_that_moved_is_found(
    walls_without_plume: TwoWalls, gain: float, row: int
) -> None:
    image = walls_without_plume.frames.images[row]
    darker = np.rint(image / gain).clip(0, 255).astype(np.uint8)
    assert gain_in(walls_without_plume, darker, row) == pytest.approx(gain, rel=1e-2)


def test_frames_of_the_same_exposure_are_left_as_they_are(walls_with_plume: TwoWalls) -> None:
    images = walls_with_plume.frames.images
    for row in range(len(images)):
        assert gain_in(walls_with_plume, images[row], row) == 1
    assert brighten(images[0], 1.0) is images[0]
    full_size = images[0].astype(np.float32)
    assert brighten_full_size(full_size, 1.0) is full_size


@pytest.mark.parametrize("level", [0, 255])
def test_clipped_frames_tell_no_gain(walls_without_plume: TwoWalls, level: int) -> None:
    clipped = np.full_like(walls_without_plume.frames.images[0], level)
    assert gain_in(walls_without_plume, clipped, 5) == 1


def test_brighter_frames_stay_within_8_bits() -> None:
    image = np.array([[0, 100, 200]], np.uint8)
    assert brighten(image, 1.5).tolist() == [[0, 150, 255]]
    assert brighten_full_size(image.astype(np.float32), 1.5).tolist() == [[0.0, 150.0, 300.0]]


def test_a_drifting_exposure_moves_no_displacement(walls_with_plume: TwoWalls) -> None:
    scene = walls_with_plume
    steady = RegisteredDetector().detect(scene.frames, scene.key)
    drifting = RegisteredDetector().detect(with_drifting_exposure(scene), scene.key)
    change = np.linalg.norm(drifting.displacement - steady.displacement, axis=-1)
    assert change.mean() < 0.03
