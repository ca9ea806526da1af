import numpy as np
import pytest

from detect.response import Response
from geometry.errors import BadInputError

LINE = Response(ratios=(0.0, 2.0, 4.0), llr=(-1.0, 1.0, 2.0))


def test_what_a_detector_gave_comes_back() -> None:
    rng = np.random.default_rng(0)
    ratios = np.append(rng.uniform(0, 12, 200_000), [20.0, 30.0])
    response = Response.from_samples(ratios, ratios / 3 - 1 + rng.normal(size=len(ratios)))
    assert response is not None
    assert max(response.ratios) < 13, "too few are larger"
    sizes_px = np.array([[0.02, 0.3], [0.6, 0.9]], np.float32)
    sigma_px = np.full((2, 2), 0.1, np.float32)
    np.testing.assert_allclose(response(sizes_px, sigma_px), sizes_px / 0.3 - 1, atol=0.05)


def test_it_is_linear_between_the_ratios_and_constant_beyond() -> None:
    sizes_px = np.array([[0.0, 0.1, 0.3, 9.0]], np.float32)
    np.testing.assert_allclose(LINE(sizes_px, np.float32(0.1)), [[-1, 0, 1.5, 2]], atol=1e-6)


def test_too_few_samples_are_no_response() -> None:
    assert Response.from_samples(np.ones(99), np.ones(99)) is None


def test_it_comes_back_from_json() -> None:
    assert Response.from_plain(LINE.to_plain(), "here") == LINE


@pytest.mark.parametrize(
    "content",
    [
        {"ratios": [0, 1]},
        {"ratios": [], "llr": []},
        {"ratios": [0, 1], "llr": [0]},
        {"ratios": [1, 0], "llr": [0, 1]},
        {"ratios": [0, 1], "llr": [0, float("nan")]},
        "words",
    ],
)
def test_anything_else_is_refused(content: object) -> None:
    with pytest.raises(BadInputError, match=r"^network\.onnx: "):
        Response.from_plain(content, "network.onnx")
