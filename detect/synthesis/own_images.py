"""Samples before the user's own background, from frames or photos of it without a plume."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from detect.synthesis.camera import (
    MARGIN_PX,
    OVERSAMPLING,
    Background,
    CameraOptics,
    expose_background,
)
from detect.synthesis.dataset import Shard
from detect.synthesis.raster import REACH_PX, as_background, canvas_side
from detect.synthesis.recipe import Recipe
from detect.synthesis.sample import Sample, Sources, render_through_plume
from geometry.arrays import FloatMap, GreyImage
from geometry.errors import BadInputError

HALF_SCALE = 0.5
LARGEST_PX, SMALLEST_PX = 256, 128
GRID_PX = 32
"""What a network's coarsest cell, 16 px of a halved image, spans in the image itself."""
PEAK_PX = (0.16, 2.0)
NOISE = (0.4, 3.0)
HAZE_PX, HAZE_CELL_PX = (0.2, 0.8), (24.0, 64.0)
"""Root mean square of the displacement, and how far it reaches, px of the images.

Stronger haze outweighs the rest of the loss and teaches less."""
HAZE_BLUR_PX = 0.1

Progress = Callable[[float], None]


def sample_own_images(
    images: Sequence[GreyImage],
    count: int,
    *,
    seed: int,
    scale: float,
    largest_px: int = LARGEST_PX,
    progress: Progress = lambda _: None,
) -> Shard:
    """Parts of the images, through plumes and through still air, on the images' own pixel grid.

    At half the size there is no leak by construction: all detail of the background is real, and
    it is displaced by the camera of `detect.synthesis.camera`. At full size what lies near the
    finest period is blurred; such samples are for a network that halves them first.

    Displacement and noise are of the same plumes and cameras at either scale. Lens blur and most
    of the sensor's share are in the images already, so the camera adds little.

    Args:
        images: Each (H, W) uint8, without a plume.
        count: How many samples.
        seed: Of every random choice.
        scale: Of the samples to the images, `HALF_SCALE` or 1.
        largest_px: Side of a sample at most, px of the images.
        progress: Called with the share done.

    Raises:
        BadInputError: An image is too small.
    """
    recipe, sources = _build_recipe(images, scale, largest_px), Sources()

    def one(rng: np.random.Generator) -> Sample:
        background = _draw_part(images, recipe.size_px, scale, rng)
        return render_through_plume(background, "photo", rng, recipe, sources, shift_px=0)

    return Shard.from_samples([one(rng) for rng in _seeded_generators(count, seed, progress)])


def sample_hazy_images(
    images: Sequence[GreyImage],
    count: int,
    *,
    seed: int,
    scale: float,
    progress: Progress = lambda _: None,
) -> Shard:
    """The same through haze that displaces every pixel, by a fraction of a pixel to two.

    A plume displaces few pixels and these little, and a network that is shown nothing else stays
    at zero; haze soon teaches it the background. For the arguments see `sample_own_images`.
    """
    recipe = _build_recipe(images, scale, LARGEST_PX)
    inside = slice(MARGIN_PX, -MARGIN_PX)

    def one(rng: np.random.Generator) -> Sample:
        background = _draw_part(images, recipe.size_px, scale, rng)
        haze = _draw_haze(recipe.size_px + 2 * MARGIN_PX, scale, rng)
        noise = float(np.exp(rng.uniform(*np.log(recipe.noise))))
        optics = CameraOptics(psf_sigma_px=HAZE_BLUR_PX, noise=noise)
        image = expose_background(background, [haze], np.zeros(2), optics, rng)
        displacement = haze[inside, inside]
        mask = np.linalg.norm(displacement, axis=-1) > recipe.visible_px
        return Sample(image=image, displacement=displacement, mask=mask, family="photo")

    return Shard.from_samples([one(rng) for rng in _seeded_generators(count, seed, progress)])


def _build_recipe(images: Sequence[GreyImage], scale: float, largest_px: int) -> Recipe:
    return Recipe(
        size_px=round(sample_side(images, largest_px) * scale),
        families={"photo": 1},
        photos=Path(),
        peak_px=(PEAK_PX[0] * scale, PEAK_PX[1] * scale),
        noise=(NOISE[0] * scale, NOISE[1] * scale),
        psf_sigma_px=(0.05, 0.2),
        gamma=(0.95, 1.05),
        jpeg_share=0.1,
        jpeg_quality=(80, 98),
    )


def _seeded_generators(count: int, seed: int, progress: Progress) -> Iterator[np.random.Generator]:
    for index in range(count):
        progress(index / count)
        yield np.random.default_rng([seed, index])


def _draw_haze(side: int, scale: float, rng: np.random.Generator) -> FloatMap:
    """(side, side, 2) px, smooth, of random coarseness and strength."""
    cell_px = np.exp(rng.uniform(*np.log(HAZE_CELL_PX))) * scale
    strength_px = np.exp(rng.uniform(*np.log(HAZE_PX))) * scale
    margin = round(3 * cell_px)
    noise = rng.standard_normal((side + 2 * margin, side + 2 * margin, 2), dtype=np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), cell_px)[margin:-margin, margin:-margin]
    return np.asarray(smooth * np.float32(strength_px / np.sqrt((smooth**2).mean())))


def sample_side(images: Sequence[GreyImage], largest_px: int) -> int:
    """The side of samples, px of the images: the smallest image whole where it is small enough.

    Raises:
        BadInputError: An image is smaller than any sample.
    """
    shortest = min(int(min(image.shape)) for image in images)
    if shortest < SMALLEST_PX:
        raise BadInputError(
            f"an image is {shortest} px on its shorter side; give {SMALLEST_PX} or more"
        )
    return min(-(-shortest // GRID_PX) * GRID_PX, largest_px)


def _draw_part(
    images: Sequence[GreyImage], size_px: int, scale: float, rng: np.random.Generator
) -> Background:
    """A random part of a random image, on the grid that the whole image has in a network.

    Beyond its edges the image is mirrored, as a network sees it.
    """
    image = images[int(rng.integers(len(images)))]
    side, reach = canvas_side(size_px), round(REACH_PX / scale)
    crop = round(side / OVERSAMPLING / scale)
    image = cv2.copyMakeBorder(
        image, *(reach, reach + GRID_PX) * 2, borderType=cv2.BORDER_REFLECT_101
    )
    steps = ((n - crop) // GRID_PX for n in image.shape)
    y, x = (GRID_PX * int(rng.integers(most + 1)) for most in steps)
    part = image[y : y + crop, x : x + crop].astype(np.float32) / 255
    enlarged = cv2.resize(part, (side, side), interpolation=cv2.INTER_CUBIC)
    return as_background(np.clip(enlarged, 0, 1))
