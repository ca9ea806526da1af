from pathlib import Path

import cv2
import numpy as np
import pytest

from detect.synthesis import Recipe, Sources, sample_at
from detect.texture import Texture, texture_classes

SEEDS = range(8)


def shares(family: str, seed: int) -> np.ndarray:
    """Of the texture classes in one synthetic image."""
    recipe = Recipe(families={family: 1}, seed=seed, split="test")
    classes = texture_classes(sample_at(0, recipe, Sources()).image)
    return np.bincount(classes.ravel(), minlength=len(Texture)) / classes.size


@pytest.mark.parametrize(
    ("family", "texture", "least"),
    [
        ("sinusoid", Texture.LATTICE, 0.9),
        ("checkerboard", Texture.LATTICE, 0.9),
        ("lines", Texture.STRAIGHT, 0.75),
        ("perlin", Texture.IRREGULAR, 0.9),
        ("squares", Texture.IRREGULAR, 0.9),
    ],
)
def test_families_fall_into_their_classes(family: str, texture: Texture, least: float) -> None:
    assert np.mean([shares(family, seed) for seed in SEEDS], axis=0)[texture] > least


def test_noise_alone_is_flat() -> None:
    noise = np.random.default_rng(0).normal(120, 2, (200, 300))
    assert (texture_classes(noise.round().astype(np.uint8)) == Texture.FLAT).all()
    assert (texture_classes(np.full((64, 64), 90, np.uint8)) == Texture.FLAT).all()


def test_each_part_of_an_image_is_judged_by_itself() -> None:
    rng = np.random.default_rng(0)
    image = rng.normal(120, 1, (192, 384))
    image[:, :192] += 50 * np.sin(2 * np.pi * np.arange(192) / 9)
    image[:, 192:] += 30 * cv2.GaussianBlur(rng.normal(size=(192, 192)), (0, 0), 2) / 0.14
    classes = texture_classes(np.clip(image, 0, 255).astype(np.uint8))
    assert (classes[:, :128] == Texture.LATTICE).all()
    assert (classes[:, 256:] == Texture.IRREGULAR).all()


@pytest.mark.parametrize("shape", [(1, 1), (20, 300), (64, 64), (65, 97)])
def test_any_size(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 255, shape, dtype=np.uint8)
    assert texture_classes(image).shape == shape


def test_photos_are_no_lattices(shared_data: Path) -> None:
    paths = sorted((shared_data / "3_backgrounds").rglob("*.[pw]*"))[::15]
    assert len(paths) > 5
    share = [
        np.mean(texture_classes(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) == Texture.LATTICE)
        for path in paths
    ]
    assert np.mean(share) < 0.02
