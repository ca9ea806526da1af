import numpy as np
import pytest

from detect.dybs.demodulation import demodulate_lattice
from detect.dybs.phase_plane import PhasePlane
from detect.scores import auroc
from detect.synthesis import Recipe, Sources, sample_at

SIDE = 192


def plume(height: int = SIDE, width: int = SIDE, peak_px: float = 0.4) -> np.ndarray:
    """The slope of a bump that covers a small part: steepest `peak_px`."""
    y, x = np.mgrid[:height, :width] - np.array([0.45 * height, 0.55 * width])[:, None, None]
    sigma = 14.0
    bump = np.exp(-(x**2 + y**2) / (2 * sigma**2)) * np.exp(0.5) / sigma * peak_px
    return np.stack([x, y], axis=-1) * bump[..., None]


def lattice(
    displacement: np.ndarray, waves: list[tuple[float, float]], seed: int = 0
) -> np.ndarray:
    """A photo of waves (cycles per px) on a slanted wall: pixel p shows p + displacement(p)."""
    height, width = displacement.shape[:2]
    y, x = np.mgrid[:height, :width].astype(float)
    x, y = x + displacement[..., 0], y + displacement[..., 1]
    near = 1 / (1 + 0.1 * (x / width - 0.5) - 0.05 * (y / height - 0.5))
    total = sum(np.sin(2 * np.pi * near * (a * x + b * y) + 0.7) for a, b in waves)
    noise = np.random.default_rng(seed).normal(0, 1, x.shape)
    return np.clip(120 + 60 * total / len(waves) + noise, 0, 255).round().astype(np.uint8)


def everywhere(image: np.ndarray) -> np.ndarray:
    return np.ones(image.shape, bool)


def test_two_waves_give_the_whole_displacement_with_its_sign() -> None:
    truth = plume()
    image = lattice(truth, [(0.12, 0.02), (-0.03, 0.11)])
    found = demodulate_lattice(image, everywhere(image)).displacement
    error = np.linalg.norm(found - truth, axis=-1)
    inside = np.linalg.norm(truth, axis=-1) > 0.1
    assert error[inside].mean() < 0.2 * np.linalg.norm(truth, axis=-1)[inside].mean()
    assert error[~inside].mean() < 0.02


@pytest.mark.parametrize(("share", "speaks"), [(0.6, True), (0.4, False)])
def test_a_lattice_that_fills_less_than_half_of_a_tile_is_left_alone(
    share: float, speaks: bool
) -> None:
    image = lattice(plume(), [(0.12, 0.02), (-0.03, 0.11)])
    there = everywhere(image)
    there[:, round(share * SIDE) :] = False
    assert demodulate_lattice(image, there).information.any() == speaks


def test_one_wave_gives_what_crosses_its_lines() -> None:
    truth = plume()
    image = lattice(truth, [(0.1, 0.0)])
    found = demodulate_lattice(image, everywhere(image))
    assert np.corrcoef(found.displacement[..., 0].ravel(), truth[..., 0].ravel())[0, 1] > 0.95
    assert np.abs(found.displacement[..., 1]).max() < 0.1 * found.displacement[..., 0].max()
    xx, xy, yy = np.moveaxis(found.information, -1, 0)
    assert np.median(xx * yy - xy**2) < 1e-3 * np.median(xx) ** 2


def test_an_undisturbed_lattice_stands_still_up_to_its_edge() -> None:
    image = lattice(np.zeros((SIDE, SIDE, 2)), [(0.07, 0.02), (-0.02, 0.08)])
    found = demodulate_lattice(image, everywhere(image)).displacement
    size = np.linalg.norm(found, axis=-1)
    assert size.mean() < 0.008  # the noise alone gives 0.006
    assert size.max() < 0.05


def test_stated_sigmas_fit_the_scatter() -> None:
    image = lattice(np.zeros((SIDE, SIDE, 2)), [(0.2, 0.02), (-0.02, 0.21)])
    found = demodulate_lattice(image, everywhere(image))
    square = np.einsum("...i,...i", found.displacement**2, found.information[..., ::2])
    assert 0.02 < square.mean() / 2 < 2


def test_checkerboards_are_told_apart_from_plumes() -> None:
    recipe = Recipe(families={"checkerboard": 1}, split="test", peak_px=(0.2, 0.6), negatives=0)
    scores, labels = [], []
    for index in range(12):
        sample = sample_at(index, recipe, Sources())
        found = demodulate_lattice(sample.image, everywhere(sample.image)).displacement
        truth = np.linalg.norm(sample.displacement, axis=-1)
        judged = (truth > 0.06) | (truth < 0.02)
        scores.append(np.linalg.norm(found, axis=-1)[judged])
        labels.append((truth > 0.06)[judged])
    assert auroc(np.concatenate(scores), np.concatenate(labels)) > 0.9


def test_nothing_is_said_outside_the_lattice() -> None:
    image = lattice(np.zeros((200, 420, 2)), [(0.1, 0.03), (-0.02, 0.13)])
    image[:, 210:] = np.random.default_rng(0).integers(0, 255, (200, 210))
    where = np.zeros(image.shape, bool)
    where[:, :200] = True
    found = demodulate_lattice(image, where)
    assert not found.information[:, 200:].any()
    assert not found.displacement[:, 200:].any()
    assert np.linalg.norm(found.displacement[:, :180], axis=-1).mean() < 0.02


@pytest.mark.parametrize("shape", [(20, 20), (129, 131), (480, 75)])
def test_any_size(shape: tuple[int, int]) -> None:
    image = lattice(np.zeros((*shape, 2)), [(0.12, 0.02), (-0.03, 0.11)])
    assert demodulate_lattice(image, everywhere(image)).displacement.shape == (*shape, 2)


def test_irregular_lines_are_no_lattice() -> None:
    recipe = Recipe(families={"lines": 1}, split="test", negatives=1)
    images = [sample_at(index, recipe, Sources()).image for index in range(6)]
    measured = [demodulate_lattice(image, everywhere(image)).information.any() for image in images]
    assert np.mean(measured) < 0.4


def test_a_plane_is_fitted_in_spite_of_outliers() -> None:
    rng = np.random.default_rng(0)
    at = rng.uniform(-0.5, 0.5, (3000, 2))
    truth = PhasePlane(
        numerators=np.array([[1, 60, 3], [2, -4, 55]]), denominator=np.array([0.1, -0.07]),
        scatter_px=0,
    )  # fmt: skip
    phases = truth.phases(at[:, 0], at[:, 1])
    phases[:, :600] += rng.uniform(0.3, 1.0, 600)
    found = PhasePlane.fit(phases, at, np.ones_like(phases), np.ones(2))
    np.testing.assert_allclose(found.denominator, truth.denominator, atol=1e-3)
    np.testing.assert_allclose(found.numerators, truth.numerators, atol=0.05)
