"""What may befall the frames of any recording, each by its name."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from detect.warp import pixel_grid, sample
from geometry.arrays import FloatArray, FloatMap, GreyImage

Trouble = Callable[[Sequence[GreyImage], np.random.Generator], list[GreyImage]]
HAZE_PX, EXHAUST_PX = 0.7, 1.0
"""Root mean square of what haze and exhaust displace, in frames 640 px wide."""


def blur_by_motion(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """Blur along a direction that turns, up to 5 px long."""
    angles = np.cumsum(rng.normal(0, 0.4, len(images)))
    lengths = rng.uniform(1, 5, len(images))
    return [
        _whole(cv2.filter2D(image, -1, _line(length, angle)))
        for image, length, angle in zip(images, lengths, angles, strict=True)
    ]


def lose_focus(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """An autofocus that hunts: Gaussian blur between 0 and 2 px, in some 12 frames."""
    phases = 2 * np.pi * (np.arange(len(images)) / 12 + rng.random())
    sigmas = 1 + np.sin(phases) + 1e-3
    return [
        _whole(cv2.GaussianBlur(image, (0, 0), s)) for image, s in zip(images, sigmas, strict=True)
    ]


def change_exposure(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """The exposure drifts by some 15 % and jumps by 25 % once."""
    drift = np.cumsum(rng.normal(0, 0.04, len(images)))
    jump = 0.25 * (np.arange(len(images)) >= len(images) * rng.uniform(0.3, 0.7))
    gains = np.exp(drift - drift.mean() - jump)
    return [_whole(image * gain) for image, gain in zip(images, gains, strict=True)]


def rain(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """Streaks in every frame, and 12 drops on the lens that stay and bend the light."""
    height, width = images[0].shape
    centers = rng.uniform(0, 1, (12, 2)) * (width, height)
    radii = rng.uniform(0.015, 0.04, 12) * width
    shift = sum(
        (
            _lens(images[0].shape, center, radius)
            for center, radius in zip(centers, radii, strict=True)
        ),
        np.zeros((height, width, 2), np.float32),
    )
    return [_add_streaks(_displace(image, shift), rng) for image in images]


def darken(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """Night: a quarter of the light, and the noise of a sensor at high gain, 6 of 255."""
    return [_whole(image / 4 + rng.normal(0, 6, image.shape)) for image in images]


def cover_with_haze(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """Hot air everywhere: a random displacement, new in every frame, over the whole of it."""
    return [_displace(image, _random_field(image.shape, HAZE_PX, rng)) for image in images]


def drive_with_exhaust(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """The bonnet of one's own vehicle in the lowest sixth, and its hot air over a corner."""
    height, width = images[0].shape
    y, x = _unit_grid(height, width)
    weight = np.exp(-(((x - 0.8) / 0.07) ** 2)) * np.clip((y - 0.45) / 0.2, 0, 1)
    bonnet = cv2.GaussianBlur(images[0], (0, 0), width / 60)
    spoilt = []
    for image in images:
        field = _random_field(image.shape, EXHAUST_PX, rng) * weight[..., None].astype(np.float32)
        spoilt.append(np.where(y > 5 / 6, bonnet, _displace(image, field)))
    return spoilt


def distort(images: Sequence[GreyImage], _rng: np.random.Generator) -> list[GreyImage]:
    """A lens whose corners lie 3 % further out, of which nobody tells."""
    height, width = images[0].shape
    y, x = _unit_grid(height, width)
    away = np.stack([(x - 0.5) * width, (y - 0.5) * height], axis=-1)
    radius = np.linalg.norm(away, axis=-1, keepdims=True) / (0.5 * np.hypot(width, height))
    return [_displace(image, (0.03 * radius**2 * away).astype(np.float32)) for image in images]


def roll_shutter(images: Sequence[GreyImage], _rng: np.random.Generator) -> list[GreyImage]:
    """Rows read in half of the time between frames: each is shifted by its share of the motion."""
    height, width = images[0].shape
    rows = np.linspace(-0.25, 0.25, height, dtype=np.float32)[:, None, None]
    return [
        _displace(image, np.broadcast_to(rows * np.asarray(motion, np.float32), (height, width, 2)))
        for image, motion in zip(images, motions_of(images), strict=True)
    ]


def compress(images: Sequence[GreyImage], _rng: np.random.Generator) -> list[GreyImage]:
    """JPEG of quality 40."""
    coded = [cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 40])[1] for image in images]
    return [np.asarray(cv2.imdecode(file, cv2.IMREAD_GRAYSCALE), np.uint8) for file in coded]


def leave(images: Sequence[GreyImage], _rng: np.random.Generator) -> list[GreyImage]:
    """Nothing."""
    return list(images)


@dataclass(frozen=True)
class Moving:
    """Something in the scene that moves; its place in the image follows the motion of the whole.

    Attributes:
        center: Of it in the first frame, 0 to 1 across and down.
        size: Half of its width and height, likewise.
        speed: Of its center, likewise, per frame.
    """

    center: tuple[float, float]
    size: tuple[float, float]
    speed: tuple[float, float] = (0.0, 0.0)

    def weights(self, images: Sequence[GreyImage]) -> list[FloatMap]:
        """(H, W, 1) 1 on it and 0 elsewhere, with soft edges, in each frame."""
        height, width = images[0].shape
        y, x = _unit_grid(height, width)
        drifts = np.cumsum([(0.0, 0.0), *motions_of(images)[:-1]], axis=0) / (width, height)
        places = drifts + self.center + np.arange(len(images))[:, None] * np.array(self.speed)
        return [
            np.exp(-(((x - u) / self.size[0]) ** 8) - ((y - v) / self.size[1]) ** 8)[
                ..., None
            ].astype(np.float32)
            for u, v in places
        ]


BUSH = Moving((0.25, 0.4), (0.15, 0.2))
FLAG = Moving((0.7, 0.25), (0.1, 0.08))
WATER = Moving((0.5, 0.85), (0.6, 0.15))
STEAM = Moving((0.65, 0.5), (0.06, 0.35))
PERSON = Moving((-0.1, 0.6), (0.04, 0.25), (0.04, 0.0))
CAR = Moving((1.3, 0.75), (0.15, 0.1), (-0.08, 0.0))


def sway_leaves(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """A bush in the wind: each of its parts swings by some 2 px about its place."""
    field = _random_field(images[0].shape, 2, rng)
    swings = np.sin(rng.uniform(0, 2 * np.pi, len(images)))
    return _displace_there(images, BUSH, [field * np.float32(swing) for swing in swings])


def wave_flag(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """A flag: waves of 4 px run across it."""
    height, width = images[0].shape
    x = np.arange(width, dtype=np.float32) / width
    fields = []
    for phase in np.cumsum(rng.uniform(0.5, 2.0, len(images))):
        wave = 4 * width / 640 * np.sin(60 * x - np.float32(phase))
        fields.append(np.broadcast_to(wave[None, :, None], (height, width, 2)))
    return _displace_there(images, FLAG, fields)


def ripple_water(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """Water in the lowest part, whose surface shows something else in every frame."""
    fields = [_random_field(image.shape, 3, rng) for image in images]
    return _displace_there(images, WATER, fields)


def let_off_steam(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """White steam, which hides up to two thirds of what is behind it."""
    steamed = []
    for image, weight in zip(images, STEAM.weights(images), strict=True):
        field = _random_field(image.shape, 1, rng)[..., 0] * 640 / image.shape[1]
        hidden = weight[..., 0] * np.clip(0.3 + 0.2 * field, 0, 0.67)
        steamed.append(_whole(image * (1 - hidden) + 230 * hidden))
    return steamed


def walk_past(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """A person walks past before the scene, in some 25 frames."""
    return _cross(images, PERSON, rng)


def drive_past(images: Sequence[GreyImage], rng: np.random.Generator) -> list[GreyImage]:
    """A car drives past before the scene, in some 15 frames."""
    return _cross(images, CAR, rng)


TROUBLES: dict[str, Trouble] = {
    "none": leave,
    "motion_blur": blur_by_motion,
    "focus": lose_focus,
    "exposure": change_exposure,
    "rain": rain,
    "night": darken,
    "haze": cover_with_haze,
    "exhaust": drive_with_exhaust,
    "distortion": distort,
    "rolling_shutter": roll_shutter,
    "jpeg": compress,
    "people": walk_past,
    "cars": drive_past,
    "leaves": sway_leaves,
    "flag": wave_flag,
    "water": ripple_water,
    "steam": let_off_steam,
    "wrong_focal": leave,
}
"""By name; `wrong_focal` is what the run is told, not what befalls the frames."""


def motions_of(images: Sequence[GreyImage]) -> list[tuple[float, float]]:
    """By how much each frame as a whole moves until the next, px."""
    return [
        cv2.phaseCorrelate(before.astype(np.float32), after.astype(np.float32))[0]
        for before, after in zip(images, [*images[1:], images[-1]], strict=True)
    ]


def _displace_there(
    images: Sequence[GreyImage], moving: Moving, fields: Sequence[FloatMap]
) -> list[GreyImage]:
    return [
        _displace(image, field * weight)
        for image, field, weight in zip(images, fields, moving.weights(images), strict=True)
    ]


def _cross(
    images: Sequence[GreyImage], moving: Moving, rng: np.random.Generator
) -> list[GreyImage]:
    """Covers each frame where the thing is by a texture of its own, which it carries along."""
    height, width = images[0].shape
    spots = rng.normal(90, 120, (height // 3, width // 3)).astype(np.float32)
    texture = cv2.resize(cv2.GaussianBlur(spots, (0, 0), 1), (width, height))
    covered = []
    for number, (image, weight) in enumerate(zip(images, moving.weights(images), strict=True)):
        carried = np.roll(texture, round(number * moving.speed[0] * width), axis=1)
        covered.append(_whole(image * (1 - weight[..., 0]) + carried * weight[..., 0]))
    return covered


def _whole(values: np.ndarray) -> GreyImage:
    return np.asarray(np.rint(values).clip(0, 255), np.uint8)


def _unit_grid(height: int, width: int) -> tuple[FloatArray, FloatArray]:
    """Rows and columns of the pixels, 0 to 1."""
    y, x = np.mgrid[:height, :width]
    return y / height, x / width


def _line(length: float, angle: float) -> FloatMap:
    size = 2 * int(np.ceil(length)) + 1
    kernel = np.zeros((size, size), np.float32)
    half = np.array([np.cos(angle), np.sin(angle)]) * length / 2
    middle = size // 2
    for share in np.linspace(-1, 1, 4 * size):
        x, y = np.rint(middle + share * half).astype(int)
        kernel[y, x] += 1
    return np.asarray(kernel / kernel.sum())


def _displace(image: GreyImage, shift: FloatMap) -> GreyImage:
    return _whole(sample(image, pixel_grid(image.shape) + shift))


def _random_field(shape: tuple[int, ...], rms_px: float, rng: np.random.Generator) -> FloatMap:
    """(H, W, 2) smooth over a thirtieth of the width."""
    height, width = shape
    noise = rng.normal(size=(height // 4, width // 4, 2)).astype(np.float32)
    field = cv2.resize(cv2.GaussianBlur(noise, (0, 0), width / 120), (width, height))
    return np.asarray(field * (rms_px * width / 640 / field.std()), np.float32)


def _lens(shape: tuple[int, ...], center: FloatArray, radius: float) -> FloatMap:
    """(H, W, 2) of a drop, which turns what is behind it upside down towards its rim."""
    height, width = shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    away = np.stack([x - center[0], y - center[1]], axis=-1)
    share = np.clip(1 - (away**2).sum(axis=-1, keepdims=True) / radius**2, 0, 1)
    return np.asarray(-1.5 * share * away, np.float32)


def _add_streaks(image: GreyImage, rng: np.random.Generator) -> GreyImage:
    height, width = image.shape
    layer = np.zeros((height, width), np.float32)
    for x, y, length in rng.uniform(0, 1, (width // 4, 3)) * (width, height, height / 12):
        end = (round(x + length / 8), round(y + length))
        cv2.line(layer, (round(x), round(y)), end, float(rng.uniform(15, 50)), 1, cv2.LINE_AA)
    return _whole(image + layer)
