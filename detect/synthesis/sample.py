"""One synthetic image, and the displacement that is in it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from detect.synthesis.camera import MARGIN_PX, Background, CameraOptics, expose_background
from detect.synthesis.flows import random_turbulence, read_run, runs_in
from detect.synthesis.patterns import (
    draw_checkerboard,
    draw_parallel_lines,
    draw_sinusoid,
    light_unevenly,
    view_obliquely,
)
from detect.synthesis.placement import PlumePlacement
from detect.synthesis.raster import (
    as_background,
    canvas_side,
    crop_photo,
    draw_perlin,
    draw_squares,
    find_photos,
)
from detect.synthesis.recipe import Family, Recipe, SampleFamily
from detect.synthesis.scenes import man_made_scene
from geometry.arrays import BoolArray, FloatMap, GreyImage


@dataclass(frozen=True, kw_only=True)
class Sample:
    """An image of a background through a plume, or through still air.

    Attributes:
        image: (H, W) grey values.
        displacement: (H, W, 2) px, x right, y down: pixel p shows the background that would stand
            at p + displacement(p) without the plume; the mean over the exposure.
        mask: (H, W) true where the displacement is above the recipe's `visible_px`.
        family: The kind of background, or "recorded".
    """

    image: GreyImage
    displacement: FloatMap
    mask: BoolArray
    family: SampleFamily


@dataclass(frozen=True, kw_only=True)
class Sources:
    """The photos and simulated runs that a recipe may draw from, sorted by name."""

    photos: tuple[Path, ...] = ()
    runs: tuple[Path, ...] = ()

    @classmethod
    def from_recipe(cls, recipe: Recipe) -> Self:
        """Looks into the recipe's folders.

        Raises:
            BadInputError: A folder holds nothing for the recipe's split.
        """
        runs = () if recipe.flows is None else runs_in(recipe.flows, recipe.split)
        return cls(photos=photos_of(recipe), runs=runs)


def photos_of(recipe: Recipe) -> tuple[Path, ...]:
    """The photos that a recipe may draw from; none where it makes no use of any.

    Raises:
        BadInputError: Its folder holds none of its split.
    """
    if recipe.photos is None or not recipe.families.get("photo"):
        return ()
    return find_photos(recipe.photos, recipe.split)


def sample_at(index: int, recipe: Recipe, sources: Sources) -> Sample:
    """Sample `index` of a recipe: the same on every machine and in every order."""
    split_key = ("train", "validation", "test").index(recipe.split)
    return make_sample(np.random.default_rng([recipe.seed, split_key, index]), recipe, sources)


def make_sample(rng: np.random.Generator, recipe: Recipe, sources: Sources) -> Sample:
    """Draws a background, a plume or none, and a camera, and takes the picture.

    A negative goes through the very same steps with a displacement of zero: it too is moved by a
    random part of a pixel and resampled.

    Args:
        rng: Draws everything.
        recipe: From what.
        sources: `Sources.from_recipe(recipe)`.

    Raises:
        BadInputError: A photo or a run cannot be read.
    """
    names = [family for family in recipe.families if recipe.families[family] > 0]
    weights = np.array([recipe.families[family] for family in names])
    family = names[int(rng.choice(len(names), p=weights / weights.sum()))]
    background = draw_background(family, rng, recipe, sources)
    return render_through_plume(background, family, rng, recipe, sources)


def render_through_plume(
    background: Background,
    family: Family,
    rng: np.random.Generator,
    recipe: Recipe,
    sources: Sources,
    *,
    shift_px: float = 0.5,
) -> Sample:
    """A picture of this background, of that family, as `make_sample` takes it.

    With or without a plume it is moved by up to `shift_px` along both axes.
    """
    exposures = int(rng.integers(1, recipe.exposures + 1))
    if rng.random() < recipe.negatives_of.get(family, recipe.negatives):
        side = recipe.size_px + 2 * MARGIN_PX
        warps = [np.zeros((side, side, 2), np.float32)] * exposures
    else:
        warps = _draw_warps(rng, recipe, sources, exposures)
    shift = rng.uniform(-shift_px, shift_px, 2)
    image = expose_background(background, warps, shift, _draw_optics(rng, recipe), rng)
    inside = slice(MARGIN_PX, -MARGIN_PX)
    displacement = np.asarray(np.mean(warps, axis=0, dtype=np.float32))[inside, inside]
    mask = np.linalg.norm(displacement, axis=-1) > recipe.visible_px
    return Sample(image=image, displacement=displacement, mask=mask, family=family)


def draw_background(
    family: Family, rng: np.random.Generator, recipe: Recipe, sources: Sources
) -> Background:
    """A random background of one family, under uneven light; patterns also at a slant."""
    size = recipe.size_px
    light = rng.uniform(-0.5, 0.5, 2) * recipe.light_fall
    tilt = rng.uniform(-0.5, 0.5, 2) * recipe.tilt
    side = canvas_side(size)
    match family:
        case "sinusoid":
            background = view_obliquely(draw_sinusoid(rng, recipe.lattice), tilt, size)
        case "checkerboard":
            background = view_obliquely(draw_checkerboard(rng, recipe.lattice), tilt, size)
        case "lines":
            background = view_obliquely(draw_parallel_lines(rng, recipe.lattice, size), tilt, size)
        case "perlin":
            background = as_background(draw_perlin(rng, side))
        case "squares":
            background = as_background(draw_squares(rng, side))
        case "scene":
            background = as_background(man_made_scene(rng, side))
        case "photo":
            path = sources.photos[rng.integers(len(sources.photos))]
            background = as_background(crop_photo(rng, side, path))
    return light_unevenly(background, light, size)


def _draw_warps(
    rng: np.random.Generator, recipe: Recipe, sources: Sources, exposures: int
) -> list[FloatMap]:
    """The displacement at each moment of the exposure, while the plume drifts on."""
    peak_px = log_uniform(rng, recipe.peak_px)
    potential = _draw_potential(rng, recipe, sources)
    placement = PlumePlacement.draw_uniform(
        rng,
        potential,
        size_px=recipe.size_px,
        relative_length=log_uniform(rng, recipe.plume_length),
        visible=recipe.visible_px / peak_px,
    )
    direction = rng.uniform(0, 2 * np.pi)
    drift = rng.uniform(*recipe.drift_px) * np.array([np.cos(direction), np.sin(direction)])
    return [
        np.float32(peak_px)
        * placement.displacement(
            potential, size_px=recipe.size_px, margin_px=MARGIN_PX, drift_px=drift * moment
        )
        for moment in (np.arange(exposures) + 0.5) / exposures - 0.5
    ]


def _draw_potential(rng: np.random.Generator, recipe: Recipe, sources: Sources) -> FloatMap:
    if not sources.runs or rng.random() < recipe.turbulence_share:
        return random_turbulence(rng)
    potentials = read_run(sources.runs[rng.integers(len(sources.runs))])
    return np.asarray(potentials[rng.integers(len(potentials))])


def _draw_optics(rng: np.random.Generator, recipe: Recipe) -> CameraOptics:
    quality = int(rng.integers(recipe.jpeg_quality[0], recipe.jpeg_quality[1] + 1))
    return CameraOptics(
        psf_sigma_px=float(rng.uniform(*recipe.psf_sigma_px)),
        noise=log_uniform(rng, recipe.noise),
        gamma=float(rng.uniform(*recipe.gamma)),
        jpeg_quality=quality if rng.random() < recipe.jpeg_share else None,
    )


def log_uniform(rng: np.random.Generator, ends: tuple[float, float]) -> float:
    """A number whose logarithm is evenly spread between those of the ends."""
    return float(np.exp(rng.uniform(*np.log(ends))))
