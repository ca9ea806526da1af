from pathlib import Path

import numpy as np
import pytest

from detect.network import Network
from geometry.errors import BadInputError
from tests.detect.onnx_files import convolution


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    kernels = np.random.default_rng(0).normal(size=(2, 3, 5, 5))
    return convolution(tmp_path / "tiny.onnx", {"flow": kernels, "logit": kernels[:1]})


def planes(height: int, width: int, channels: int = 3) -> np.ndarray:
    return np.random.default_rng(1).random((channels, height, width), dtype=np.float32)


def test_it_says_what_its_file_says(tiny: Path) -> None:
    network = Network(tiny)
    assert (network.name, network.stride, network.channels) == ("tiny", 4, 3)
    assert network.receptive_px == 8
    assert network.outputs == ["flow", "logit"]
    assert network.read_metadata("calibration") is None


@pytest.mark.parametrize("shape", [(16, 20), (17, 21), (3, 40), (1, 1)])
def test_any_size_goes_in_and_comes_out(tiny: Path, shape: tuple[int, int]) -> None:
    maps = Network(tiny)(planes(*shape))
    assert maps["flow"].shape == (2, *shape)
    assert maps["logit"].shape == (1, *shape)


def test_padding_reflects_the_image(tmp_path: Path) -> None:
    kernel = np.zeros((1, 1, 1, 7))
    kernel[..., -1] = 1  # shows what lies 3 px to the right
    path = convolution(tmp_path / "right.onnx", {"seen": kernel}, stride=8)
    image = planes(5, 13, channels=1)
    seen = Network(path)(image)["seen"][0]
    np.testing.assert_array_equal(seen[:, :10], image[0, :, 3:])
    np.testing.assert_array_equal(seen[:, 10:], image[0, :, [11, 10, 9]].T)


def test_tiles_give_what_the_whole_gives(tiny: Path) -> None:
    image = planes(93, 150)
    whole = Network(tiny)(image)
    tiled = Network(tiny, largest_px=40 * 40)(image)
    for name in whole:
        np.testing.assert_allclose(tiled[name], whole[name], atol=1e-4)


def test_tiles_without_their_margin_would_not(tmp_path: Path) -> None:
    kernels = {"flow": np.ones((1, 1, 9, 9))}
    path = convolution(tmp_path / "short.onnx", kernels, receptive_px=0)
    image = planes(64, 64, channels=1)
    whole, tiled = Network(path)(image), Network(path, largest_px=32 * 32)(image)
    assert np.abs(whole["flow"] - tiled["flow"]).max() > 1


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"schema": "other"}, "lack schema"),
        ({"schema": None}, "lack schema"),
        ({"stride": None}, "incomplete metadata"),
        ({"stride": "many"}, "incomplete metadata"),
        ({"stride": 0}, "not between 1 and 4096 px"),
        ({"channels": 1}, "expected one input"),
    ],
)
def test_a_file_that_breaks_the_contract_is_refused(
    tmp_path: Path, changed: dict, message: str
) -> None:
    path = convolution(tmp_path / "odd.onnx", {"flow": np.ones((2, 3, 1, 1))}, **changed)
    with pytest.raises(BadInputError, match=message) as caught:
        Network(path)
    assert "\n" not in str(caught.value)


def test_the_wrong_number_of_channels_is_refused(tiny: Path) -> None:
    with pytest.raises(BadInputError, match="expected"):
        Network(tiny)(planes(16, 16, channels=1))


def test_a_missing_file_and_a_foreign_one_say_so(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no such network"):
        Network(tmp_path / "none.onnx")
    path = tmp_path / "text.onnx"
    path.write_text("not a network")
    with pytest.raises(BadInputError, match="not a readable ONNX network"):
        Network(path)


def test_broken_json_in_the_metadata_is_reported(tmp_path: Path) -> None:
    kernels = {"flow": np.ones((2, 1, 1, 1))}
    path = convolution(tmp_path / "broken.onnx", kernels, calibration="{")
    with pytest.raises(BadInputError, match="calibration"):
        Network(path).read_metadata("calibration")


@pytest.mark.parametrize("changed", [{"stride": 0}, {"stride": 10**9}, {"receptive_px": 10**9}])
def test_padding_that_no_network_needs_is_refused(
    tmp_path: Path, changed: dict[str, object]
) -> None:
    path = convolution(tmp_path / "a.onnx", {"a": np.ones((1, 1, 3, 3))}, **changed)
    with pytest.raises(BadInputError, match="not between 1 and 4096 px"):
        Network(path)
