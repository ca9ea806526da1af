"""Interpolation leaves blur that tells where the warp was; the camera must leave none."""

from pathlib import Path

import cv2
import numpy as np

from detect.scores import auroc
from detect.synthesis.camera import (
    MARGIN_PX,
    Background,
    CameraOptics,
    expose_background,
    naive_warp,
)
from detect.synthesis.flows import random_turbulence
from detect.synthesis.placement import PlumePlacement
from detect.synthesis.raster import (
    as_background,
    canvas_side,
    crop_photo,
    draw_perlin,
    draw_squares,
    find_photos,
)
from detect.synthesis.scenes import man_made_scene
from geometry.arrays import FloatMap, GreyImage

SIZE = 96
PAINTERS = {"squares": draw_squares, "perlin": draw_perlin, "scene": man_made_scene}
INSIDE = slice(MARGIN_PX, -MARGIN_PX)
STILL = np.zeros((SIZE + 2 * MARGIN_PX, SIZE + 2 * MARGIN_PX, 2), np.float32)


def background(family: str, seed: int) -> Background:
    return as_background(PAINTERS[family](np.random.default_rng(seed), canvas_side(SIZE)))


def picture(
    scene: Background, warp: FloatMap, seed: int, shift: tuple[float, float] = (0.0, 0.0)
) -> GreyImage:
    optics = CameraOptics(psf_sigma_px=0.35, noise=0.3)
    return expose_background(scene, [warp], np.array(shift), optics, np.random.default_rng(seed))


def fine_detail(image: GreyImage) -> FloatMap:
    grey = image.astype(np.float32)
    return np.asarray(grey - cv2.GaussianBlur(grey, (0, 0), 0.8))


def sharpness(image: GreyImage) -> float:
    return float((fine_detail(image) ** 2).mean())


def bluntness(image: GreyImage) -> FloatMap:
    """How little of the local contrast is fine detail."""
    grey = image.astype(np.float32)
    soft = cv2.GaussianBlur(grey, (0, 0), 0.5)
    bands = (grey - soft, soft - cv2.GaussianBlur(grey, (0, 0), 0.9))
    fine, coarse = (cv2.GaussianBlur(band**2, (0, 0), 5) for band in bands)
    return np.asarray(np.log(coarse + 0.1) - np.log(fine + 0.1))


def shifted(scene: Background, shift_px: float, *, naive: bool, seed: int) -> float:
    """Mean sharpness of the scene moved rigidly, in four directions so that no detail enters."""
    values = []
    for turn in np.arange(4) * np.pi / 2 + 0.3:
        shift = shift_px * np.array([np.cos(turn), np.sin(turn)])
        if naive:
            warp = np.broadcast_to(shift.astype(np.float32), (SIZE, SIZE, 2))
            values.append(sharpness(naive_warp(picture(scene, STILL, seed), warp)))
        else:
            values.append(sharpness(picture(scene, STILL, seed, (shift[0], shift[1]))))
    return float(np.mean(values))


def relative_sharpness(naive: bool) -> np.ndarray:
    """Sharpness at shifts of 0, .125, .25 and .5 px, relative to 0, mean over scenes."""
    ratios = []
    for family in PAINTERS:
        for seed in range(2):
            scene = background(family, seed)
            row = [shifted(scene, s, naive=naive, seed=seed) for s in (0, 0.125, 0.25, 0.5)]
            ratios.append(np.array(row) / row[0])
    return np.mean(ratios, axis=0)


def separation(scenes: list[Background], *, naive: bool) -> float:
    """AUROC of local bluntness, displaced against undisplaced pixels."""
    scores, labels = [], []
    for seed, scene in enumerate(scenes):
        rng = np.random.default_rng([9, seed])
        potential = random_turbulence(rng)
        place = PlumePlacement.draw_uniform(
            rng, potential, size_px=SIZE, relative_length=2.0, visible=0.2
        )  # fmt: skip
        warp = 0.8 * place.displacement(
            potential, size_px=SIZE, margin_px=MARGIN_PX, drift_px=np.zeros(2)
        )
        if naive:
            image = naive_warp(picture(scene, STILL, seed), warp[INSIDE, INSIDE])
        else:
            shift = rng.uniform(-0.5, 0.5, 2)
            image = picture(scene, warp, seed, (shift[0], shift[1]))
        size = np.linalg.norm(warp[INSIDE, INSIDE], axis=-1)
        clear = (size > 0.15) | (size < 0.02)
        score = bluntness(image)
        scores.append((score - np.median(score))[clear])
        labels.append(size[clear] > 0.15)
    return auroc(np.concatenate(scores), np.concatenate(labels))


def test_sharpness_does_not_depend_on_the_part_of_a_pixel() -> None:
    clean, naive = relative_sharpness(naive=False), relative_sharpness(naive=True)
    print(f"sharpness at 0, .125, .25, .5 px: camera {clean.round(4)}, bilinear {naive.round(2)}")
    np.testing.assert_allclose(clean, 1, atol=0.005)
    assert naive[1] < 0.93
    assert naive[3] < 0.7


def test_no_statistic_of_blur_tells_where_the_plume_is() -> None:
    scenes = [background(family, seed) for family in ("squares", "perlin") for seed in range(15)]
    clean, naive = separation(scenes, naive=False), separation(scenes, naive=True)
    print(f"AUROC of local sharpness on patterns: camera {clean:.3f}, bilinear {naive:.3f}")
    assert naive >= 0.7
    assert 0.47 <= clean <= 0.53


def test_nor_on_photos_whose_own_detail_varies_more(shared_data: Path) -> None:
    photos = find_photos(shared_data / "3_backgrounds", "train")[::8]
    scenes = [
        as_background(crop_photo(np.random.default_rng(i), canvas_side(SIZE), path))
        for i, path in enumerate(photos)
    ]
    clean, naive = separation(scenes, naive=False), separation(scenes, naive=True)
    print(f"AUROC of local sharpness on photos: camera {clean:.3f}, bilinear {naive:.3f}")
    assert naive >= 0.58
    assert 0.45 <= clean <= 0.55
