"""Backgrounds that are pictures: finer than the camera sees, read through a spline."""

from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from detect.synthesis.camera import OVERSAMPLING, Background
from detect.synthesis.split import Split, split_of_photo
from geometry.arrays import FloatMap, GreyImage
from geometry.errors import BadInputError
from geometry.image_files import read_image

REACH_PX = 8
"""How far beyond the frame a picture goes: lens blur, shift, and the largest displacement."""
ORDER: Final = 3
SOFTENING_PX = 0.6
"""Blur of every picture, in its own fine pixels; a cubic spline is then as good as exact."""
SQUARE_ODDS = (0.17, 0.17, 0.66)
"""Of black, white, and what lies below."""
PHOTO_SUFFIXES = {".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp"}
LEAST_SIDE_PX = 64
FINEST_ZOOM = 1.0


def canvas_side(size_px: int) -> int:
    """Side of the picture, in fine pixels, that a frame needs."""
    return (size_px + 2 * REACH_PX) * OVERSAMPLING


def as_background(picture: FloatMap) -> Background:
    """A picture of `canvas_side` as radiance at any position in or near the frame."""
    soft = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), SOFTENING_PX)
    coefficients = spline_filter(soft, ORDER, output=np.float32, mode="mirror")

    def radiance(x: FloatMap, y: FloatMap) -> FloatMap:
        first = np.float32((REACH_PX + 0.5) * OVERSAMPLING - 0.5)
        places = [y * np.float32(OVERSAMPLING) + first, x * np.float32(OVERSAMPLING) + first]
        values = np.empty(x.shape, np.float32)
        map_coordinates(coefficients, places, values, order=ORDER, prefilter=False, mode="mirror")
        return values

    return radiance


def draw_perlin(rng: np.random.Generator, side: int) -> FloatMap:
    """Gradient noise in a few octaves (Perlin, SIGGRAPH 1985), as on printed BOS backgrounds."""
    coarse = int(rng.integers(5, 8))
    octaves = range(3, coarse + 1)
    falloff = rng.uniform(0.5, 1.0)
    total = sum(2.0 ** (falloff * (o - coarse)) * _perlin_octave(rng, side, 2**o) for o in octaves)
    return stretch_contrast(np.asarray(total), rng)


def _perlin_octave(rng: np.random.Generator, side: int, cell: int) -> FloatMap:
    """One octave with gradients on a lattice of `cell` pixels, as one matrix product."""
    count = side // cell + 1
    angles = rng.uniform(0, 2 * np.pi, (count + 1, count + 1)).astype(np.float32)
    t = (np.arange(cell, dtype=np.float32) + 0.5) / cell
    fade = t**3 * (t * (6 * t - 15) + 10)
    gradients, ramps = [], []
    for down, across in product((0, 1), repeat=2):
        weight = (fade if down else 1 - fade)[:, None] * (fade if across else 1 - fade)
        corner = angles[down : down + count, across : across + count].ravel()
        gradients += [np.cos(corner), np.sin(corner)]
        ramps += [weight * (t - across), weight * (t - down)[:, None]]
    blocks = np.array(gradients).T @ np.array(ramps).reshape(8, -1)
    tiled = blocks.reshape(count, count, cell, cell).transpose(0, 2, 1, 3)
    return np.asarray(tiled.reshape(count * cell, -1)[:side, :side], dtype=np.float32)


def draw_squares(rng: np.random.Generator, side: int) -> FloatMap:
    """Black and white squares of five sizes, the small ones painted over the large ones."""
    picture = np.full((side, side), 0.5, np.float32)
    finest = int(rng.integers(6, 17))
    for edge in finest * 2 ** np.arange(4, -1, -1):
        count = side // edge + 2
        tones = rng.choice([0.0, 1.0, np.nan], (count, count), p=SQUARE_ODDS)
        y, x = rng.integers(0, edge, 2)
        layer = tones.repeat(edge, axis=0).repeat(edge, axis=1)[y : y + side, x : x + side]
        picture = np.where(np.isnan(layer), picture, layer)
    return stretch_contrast(np.asarray(picture, dtype=np.float32), rng)


def stretch_contrast(picture: FloatMap, rng: np.random.Generator) -> FloatMap:
    """The picture with a random contrast, within black and white."""
    spread = picture.std() + 1e-6
    middle, amplitude = rng.uniform(0.35, 0.6), rng.uniform(0.06, 0.24)
    toned = middle + amplitude * (picture - picture.mean()) / spread
    return np.asarray(np.clip(toned, 0.01, 0.99), dtype=np.float32)


def find_photos(folder: Path, split: Split) -> tuple[Path, ...]:
    """The photos under a folder that belong to a split, sorted.

    Raises:
        BadInputError: There are none.
    """
    found = (p for p in sorted(folder.rglob("*")) if p.suffix.lower() in PHOTO_SUFFIXES)
    photos = tuple(path for path in found if split_of_photo(path) == split)
    if not photos:
        raise BadInputError(f"{folder}: no photos for the {split} split, name a larger collection")
    return photos


@lru_cache(maxsize=512)
def read_photo(path: Path) -> GreyImage:
    """A photo in grey.

    Raises:
        BadInputError: It cannot be read, or is tiny.
    """
    image = read_image(path)
    if min(image.shape) < LEAST_SIDE_PX:
        raise BadInputError(f"{path}: not a photo of {LEAST_SIDE_PX} px or more a side")
    return image


def crop_photo(rng: np.random.Generator, side: int, path: Path) -> FloatMap:
    """A random crop of a photo, flipped at random; its pixels become fine pixels or larger ones.

    Raises:
        BadInputError: The photo cannot be read.
    """
    image = read_photo(path)
    most = min(min(image.shape) / side, FINEST_ZOOM)
    crop = round(side * rng.uniform(0.6, 1) * most)
    y, x = (int(rng.integers(0, n - crop + 1)) for n in image.shape)
    part = image[y : y + crop, x : x + crop][:, :: rng.choice([-1, 1])]
    enlarged = cv2.resize(
        np.asarray(part, dtype=np.float32), (side, side), interpolation=cv2.INTER_CUBIC
    )
    return np.asarray(np.clip(enlarged / 255, 0, 1), dtype=np.float32)
