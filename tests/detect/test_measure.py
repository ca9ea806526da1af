from pathlib import Path

import numpy as np
import pytest

from detect.dybs.pattern_measurement import (
    CHANNELS,
    TENSOR,
    VECTORS,
    measure_pattern,
    network_channels,
)
from detect.dybs.refinement import RefinementNetwork
from detect.learning.augmentation import apply_symmetry
from detect.learning.measured_samples import measure_samples
from detect.synthesis import Recipe, Sources, render_dataset, sample_at, shards_in
from detect.texture import texture_classes
from geometry.errors import BadInputError
from tests.detect.onnx_files import convolution
from tests.detect.test_demodulation import lattice, plume


def image_of(family: str, index: int = 0) -> np.ndarray:
    recipe = Recipe(families={family: 1}, peak_px=(0.4, 0.9), negatives=0, tilt=0.1)
    return sample_at(index, recipe, Sources()).image


@pytest.mark.parametrize("symmetry", [1, 2, 4, 7])
@pytest.mark.parametrize("family", ["sinusoid", "lines"])
def test_channels_turn_with_the_image(family: str, symmetry: int) -> None:
    image = image_of(family)
    turned = apply_symmetry(image[None].astype(np.float32), symmetry, ())[0].astype(np.uint8)
    direct = network_channels(measure_pattern(turned, texture_classes(turned)))
    expected = apply_symmetry(
        network_channels(measure_pattern(image, texture_classes(image))),
        symmetry,
        VECTORS,
        (TENSOR,),
    )
    inside = (slice(None), slice(12, -12), slice(12, -12))
    for plane, other in zip(direct[inside], expected[inside], strict=True):
        assert np.ptp(other) < 0.05 or np.corrcoef(plane.ravel(), other.ravel())[0, 1] > 0.8


def test_waves_are_measured_on_a_lattice_and_edges_elsewhere() -> None:
    image = lattice(plume(192, 384), [(0.12, 0.02), (-0.03, 0.11)])
    image[:, 200:] = 90
    image[:, 300:] = 160
    measured = measure_pattern(image, texture_classes(image))
    assert measured.lattice[:, :70].mean() > 0.95
    assert not measured.lattice[:, 130:].any()
    assert measured.certainty[10:-10, 148:152].min() > 100
    assert not measured.length[:, :70].any()


def test_an_image_of_neither_is_left_alone() -> None:
    image = np.random.default_rng(0).integers(0, 256, (130, 150), dtype=np.uint8)
    assert not measure_pattern(image, texture_classes(image)).certainty.any()


def test_samples_become_channels(tmp_path: Path) -> None:
    recipe = Recipe(families={"sinusoid": 1, "lines": 1}, size_px=64)
    render_dataset(recipe, 6, tmp_path / "samples")
    assert list(measure_samples(tmp_path / "samples", tmp_path / "measured")) == [1]
    (before,), (after,) = (list(shards_in(tmp_path / n)) for n in ("samples", "measured"))
    assert after.images.shape == (6, 32, 32, CHANNELS)
    assert after.images.dtype == np.float16
    np.testing.assert_array_equal(after.families, before.families)
    mean = before.displacements.astype(float).reshape(6, 32, 2, 32, 2, 2).mean(axis=(2, 4))
    np.testing.assert_allclose(after.displacements, mean, atol=2e-3)


def judge_of(path: Path, seen: int | None = None) -> RefinementNetwork:
    """Says that nothing moves, and of the logit what it sees in one channel."""
    first = np.zeros((1, CHANNELS, 1, 1))
    if seen is not None:
        first[0, seen] = 1
    nothing = np.zeros((2, CHANNELS, 1, 1))
    kernels = {"displacement": nothing, "log_variance": nothing[:1], "logit": first}
    return RefinementNetwork(convolution(path, kernels))


def test_a_judge_answers_at_the_size_of_the_image(tmp_path: Path) -> None:
    image = image_of("lines")[:101, :75]
    measured = measure_pattern(image, texture_classes(image))
    says = judge_of(tmp_path / "judge.onnx", seen=-1)(measured, image.shape)
    assert says["displacement"].shape == (101, 75, 2)
    assert np.corrcoef(says["logit"][::2, ::2].ravel(), measured.length.ravel())[0, 1] > 0.98
    assert not says["displacement"].any()


def test_waves_that_are_sure_overrule_a_judge_that_is_not(tmp_path: Path) -> None:
    truth = plume(peak_px=0.6)
    image = lattice(truth, [(0.12, 0.02), (-0.03, 0.11)])
    measured = measure_pattern(image, texture_classes(image))
    says = judge_of(tmp_path / "judge.onnx")(measured, image.shape)
    strong = np.linalg.norm(truth, axis=-1) > 0.3
    error = np.linalg.norm(says["displacement"] - truth, axis=-1)
    assert error[strong].mean() < 0.1
    assert says["log_variance"][strong].max() < np.log(0.1**2)


@pytest.mark.parametrize("channels_in", [1, CHANNELS])
def test_a_network_of_another_kind_refines_nothing(tmp_path: Path, channels_in: int) -> None:
    path = convolution(tmp_path / "n.onnx", {"logit": np.zeros((1, channels_in, 1, 1))})
    with pytest.raises(BadInputError, match="not a refinement network"):
        RefinementNetwork(path)
