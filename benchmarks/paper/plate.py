"""A camera at rest before a sinusoid of 8 px, and plumes deflected by wind and by a plate."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from benchmarks.flow.simulated import sinusoid
from detect.synthesis.buoyancy import BuoyantFlow
from detect.synthesis.camera import (
    MARGIN_PX,
    OVERSAMPLING,
    Background,
    CameraOptics,
    expose_background,
)
from detect.synthesis.flows import CELL_M, CELLS, FlowSource, potential_gradient
from geometry.arrays import BoolArray, FloatArray, FloatMap, GreyImage

BESIDE_PX = 16
SIZE_PX, CELL_PX, BASE_PX = 480, 6.0, 36
PEAK_PX, NOISE, REFERENCE_FRAMES, VIBRATION_PX = 0.6, 1.0, 50, 0.2
MOMENTS, INTERVAL_S = 6, 0.3
PLATE_CELLS, PLATE_TONE, MOVED_PX = (20.0, 38.0, 30.0), 0.25, 3.0
"""Left end, right end and height of the plate; 3 cells thick, 24 deep."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What deflects a plume, and where the plate stood when the reference was taken."""

    name: str
    wind_mps: float = 0.0
    plate: bool = False
    reference_shift_px: float | None = 0.0


SETUPS = (
    Setup(name="undisturbed"),
    Setup(name="wind", wind_mps=0.3),
    Setup(name="plate, at rest", plate=True),
    Setup(name="plate, moved by 4 px", plate=True, reference_shift_px=MOVED_PX),
    Setup(name="plate, brought in", plate=True, reference_shift_px=None),
)


@cache
def flow_moments(wind_mps: float, plate: bool) -> list[FloatMap]:
    """(SIZE, SIZE, 2) with margins: the displacement at each moment, its 99.9th percentile PEAK."""
    solid = np.zeros(CELLS, dtype=bool)
    if plate:
        left, right, height = PLATE_CELLS
        x, y, z = np.indices(CELLS)
        solid = (x >= left) & (x < right) & (abs(y - CELLS[1] / 2) < 12) & (abs(z - height) < 1.5)
    rng = np.random.default_rng(2)
    source = FlowSource(gas="air", mole_fraction=1.0, temperature_k=440.0)
    flow = BuoyantFlow(
        CELLS,
        cell_m=CELL_M,
        radius_m=0.1,
        deficit=0.33,
        exit_mps=0.3,
        rng=rng,
        wind_mps=wind_mps,
        solid=solid,
    )
    flow.develop()
    fields = []
    for _ in range(MOMENTS):
        flow.advance(INTERVAL_S)
        excess = source.excess_refractivity(np.clip(flow.tracer, 0, 1)).sum(axis=1)
        fields.append(in_frame(excess))
    peak = np.percentile([np.linalg.norm(w, axis=-1) for w in fields], 99.9)
    return [np.asarray(w * np.float32(PEAK_PX / peak)) for w in fields]


def in_frame(excess: FloatMap) -> FloatMap:
    """The gradient of an integral over (across, up), in a frame that stands on the heat source."""
    y, x = np.mgrid[
        -MARGIN_PX - 1 : SIZE_PX + MARGIN_PX + 1, -MARGIN_PX - 1 : SIZE_PX + MARGIN_PX + 1
    ]
    up = (SIZE_PX - BASE_PX - y) / CELL_PX
    across = (x - SIZE_PX / 2) / CELL_PX + (CELLS[0] - 1) / 2
    soft = cv2.GaussianBlur(excess.T, (0, 0), 0.8)
    potential = cv2.remap(
        soft, across.astype(np.float32), up.astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    potential = cv2.GaussianBlur(potential, (0, 0), CELL_PX)
    return potential_gradient(potential)[1:-1, 1:-1]


Covered = Callable[[FloatArray, FloatArray], BoolArray]


def objects(setup: Setup, shift_px: float | None) -> Covered:
    """Whether the heat source, the plate or its rod covers a place of the frame."""

    def covered(x: FloatArray, y: FloatArray) -> BoolArray:
        source = (np.abs(x - SIZE_PX / 2) < 70) & (y > SIZE_PX - BASE_PX)
        if not setup.plate or shift_px is None:
            return source
        left, right, height = PLATE_CELLS
        across = (x - shift_px - SIZE_PX / 2) / CELL_PX + CELLS[0] / 2
        up = (SIZE_PX - BASE_PX - y + shift_px) / CELL_PX - height
        plate = (across >= left) & (across < right) & (np.abs(up) < 1.5)
        rod = (across >= right) & (np.abs(up) < 0.5)
        return source | plate | rod

    return covered


def with_objects(covered: Covered, shake_px: FloatArray) -> Background:
    """The sinusoid, and in front of it what the plume does not displace."""

    def radiance(x: FloatMap, y: FloatMap) -> FloatMap:
        down, across = (
            (np.arange(n) + 0.5) / OVERSAMPLING - 0.5 - MARGIN_PX + shake
            for n, shake in zip(x.shape, shake_px[::-1], strict=True)
        )
        in_front = covered(across[None], down[:, None])
        return np.where(in_front, np.float32(PLATE_TONE), sinusoid(x, y))

    return radiance


def film_setup(setup: Setup) -> Iterator[tuple[GreyImage, GreyImage, FloatMap, BoolArray]]:
    """Reference, frame, truth, and what objects cover in either."""
    rng = np.random.default_rng(5)
    grid = np.meshgrid(np.arange(float(SIZE_PX)), np.arange(float(SIZE_PX)))
    then, now = objects(setup, setup.reference_shift_px), objects(setup, 0.0)
    still = np.zeros((SIZE_PX + 2 * MARGIN_PX,) * 2 + (2,), np.float32)
    optics = CameraOptics(noise=NOISE / REFERENCE_FRAMES**0.5)
    reference = expose_background(
        with_objects(then, np.zeros(2)), [still], np.zeros(2), optics, rng
    )
    for w in flow_moments(setup.wind_mps, setup.plate):
        shake = rng.uniform(-VIBRATION_PX, VIBRATION_PX, 2)
        image = expose_background(
            with_objects(now, shake), [w], shake, CameraOptics(noise=NOISE), rng
        )
        inside = slice(MARGIN_PX, -MARGIN_PX)
        yield reference, image, w[inside, inside], now(*grid) | then(*grid)
