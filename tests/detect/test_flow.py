import numpy as np
import pytest

from detect.flow import METHODS, flow_method
from geometry.errors import BadInputError
from tests.detect.scenes import Texture, photographed, ring_displacement

SHAPE = (120, 160)
PEAK_PX = 0.3
MEAN_ERROR_PX = {
    "horn-schunck": 0.05,
    "lucas-kanade": 0.03,
    "dis": 0.03,
    "farneback": 0.03,
    "deepflow": 0.04,
    "pcaflow": 0.04,
}


@pytest.fixture(scope="module")
def pair() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    texture = Texture(0, 1.2)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    w = ring_displacement(SHAPE, PEAK_PX, 25.0)
    reference = photographed(texture(x, y), seed=1)
    image = photographed(texture(x + w[..., 0], y + w[..., 1]), seed=2)
    return reference, image, w


@pytest.mark.parametrize("name", METHODS)
def test_a_smooth_displacement_is_found_with_its_sign(name: str, pair: tuple) -> None:
    reference, image, w = pair
    found = flow_method(name)(reference, image)
    assert found.shape == w.shape
    inside = np.hypot(w[..., 0], w[..., 1]) > PEAK_PX / 2
    error = np.linalg.norm(found - w, axis=-1)[inside].mean()
    gain = (found * w)[inside].sum() / (w * w)[inside].sum()
    assert error < MEAN_ERROR_PX[name]
    assert 0.88 < gain < 1.1


def test_every_method_has_a_stated_error() -> None:
    assert set(MEAN_ERROR_PX) == set(METHODS)


def test_an_unknown_method_is_named_with_its_alternatives() -> None:
    with pytest.raises(BadInputError, match=r"'warp'.*horn-schunck"):
        flow_method("warp")
