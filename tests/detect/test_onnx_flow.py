from pathlib import Path

import numpy as np
import pytest

from detect.flow import flow_method
from geometry.errors import BadInputError
from tests.detect.onnx_files import message, tensor


def network(path: Path, inputs: list[bytes], names: list[str], operation: str) -> str:
    axis = message((1, b"axis"), (3, 1), (20, 2))
    attributes = [(5, axis)] if operation == "Concat" else []
    node = message(
        *((1, name.encode()) for name in names), (2, b"flow"), (4, operation.encode()), *attributes
    )
    output = tensor("flow", 2, "oh", "ow")
    graph = message((1, node), (2, b"g"), *((11, i) for i in inputs), (12, output))
    path.write_bytes(message((1, 8), (7, graph), (8, message((2, 13)))))
    return str(path)


@pytest.fixture
def pair() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    reference, image = rng.integers(0, 256, (2, 21, 30), dtype=np.uint8)
    return reference, image


def test_two_inputs_are_the_image_then_the_reference(tmp_path: Path, pair: tuple) -> None:
    inputs = [tensor("a", 1), tensor("b", 1)]
    name = network(tmp_path / "two.onnx", inputs, ["a", "b"], "Concat")
    found = flow_method(name)(*pair)
    np.testing.assert_array_equal(found[..., 0], pair[1])
    np.testing.assert_array_equal(found[..., 1], pair[0])


def test_one_input_holds_both(tmp_path: Path, pair: tuple) -> None:
    name = network(tmp_path / "one.onnx", [tensor("a", 2)], ["a"], "Identity")
    found = flow_method(name)(*pair)
    np.testing.assert_array_equal(found[..., 0], pair[1])


def test_a_network_of_fixed_size_gets_resized_images(tmp_path: Path) -> None:
    reference, image = np.full((2, 24, 32), 100, np.uint8)
    name = network(tmp_path / "fixed.onnx", [tensor("a", 2, 48, 96)], ["a"], "Identity")
    found = flow_method(name)(reference, image)
    assert found.shape == (24, 32, 2)
    np.testing.assert_allclose(found[..., 0], 100 * 32 / 96, rtol=1e-5)
    np.testing.assert_allclose(found[..., 1], 100 * 24 / 48, rtol=1e-5)


def test_inputs_that_are_no_image_pair_are_refused(tmp_path: Path) -> None:
    name = network(tmp_path / "five.onnx", [tensor("a", 5)], ["a"], "Identity")
    with pytest.raises(BadInputError, match=r"inputs .*expected one"):
        flow_method(name)


def test_an_output_that_is_no_flow_is_refused(tmp_path: Path, pair: tuple) -> None:
    inputs = [tensor("a", 3), tensor("b", 3)]
    name = network(tmp_path / "six.onnx", inputs, ["a", "b"], "Concat")
    with pytest.raises(BadInputError, match="output"):
        flow_method(name)(*pair)


def test_a_missing_network_says_so(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no such flow network"):
        flow_method(str(tmp_path / "none.onnx"))


def test_a_file_that_is_no_network_says_so(tmp_path: Path) -> None:
    path = tmp_path / "bad.onnx"
    path.write_text("not a network")
    with pytest.raises(BadInputError, match="not a readable ONNX network"):
        flow_method(str(path))
