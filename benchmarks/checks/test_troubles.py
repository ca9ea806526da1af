"""Troubles befall frames as they say, and the scene without a plume is otherwise the sample's."""

import numpy as np
import pytest

from benchmarks.troubles.film import scene_without_plume
from benchmarks.troubles.images import TROUBLES, distort
from geometry.arrays import FloatArray, GreyImage
from locate.recording.sample import SAMPLE
from locate.simulation.scene import Scene

HEIGHT, WIDTH = 96, 128
UNTOUCHED = ("none", "wrong_focal")


def waves(x: FloatArray, y: FloatArray) -> GreyImage:
    """Texture that is known between pixels."""
    light = 128 + 50 * np.sin(0.5 * x + 0.2 * y) + 50 * np.sin(0.3 * x - 0.5 * y)
    return np.asarray(np.rint(light), np.uint8)


def recorded() -> list[GreyImage]:
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    return [waves(x + 3.0 * i, y) for i in range(8)]


@pytest.mark.parametrize("name", TROUBLES)
def test_every_trouble_befalls_frames_that_stay_frames(name: str) -> None:
    images = recorded()
    spoilt = TROUBLES[name](images, np.random.default_rng(0))
    again = TROUBLES[name](images, np.random.default_rng(0))
    assert [image.shape for image in spoilt] == [(HEIGHT, WIDTH)] * len(images)
    assert {image.dtype for image in spoilt} == {np.dtype(np.uint8)}
    for one, other, image in zip(spoilt, again, images, strict=True):
        np.testing.assert_array_equal(one, other)
        if name in UNTOUCHED:
            np.testing.assert_array_equal(one, image)
    assert name in UNTOUCHED or any(
        (one != image).any() for one, image in zip(spoilt, images, strict=True)
    )


def test_displaced_frames_are_read_exactly_between_pixels() -> None:
    (spoilt,) = distort(recorded()[:1], np.random.default_rng(0))
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    away_x, away_y = x - WIDTH / 2, y - HEIGHT / 2
    share = 0.03 * (away_x**2 + away_y**2) / (WIDTH**2 + HEIGHT**2) * 4
    exact = waves(x + share * away_x, y + share * away_y)
    inner = np.s_[6:-6, 6:-6]
    error = spoilt[inner].astype(float) - exact[inner]
    assert np.sqrt((error**2).mean()) < 0.7


def test_the_scene_without_a_plume_is_the_samples_otherwise() -> None:
    filmed, sample = scene_without_plume(), Scene.load(SAMPLE / "scene.yaml")
    assert not filmed.plumes
    assert filmed.model_copy(update={"plumes": sample.plumes}) == sample
