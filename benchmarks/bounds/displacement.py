"""The error of a displacement beside the Cramer-Rao bound of its window; a camera at rest.

    OMP_NUM_THREADS=1 python -m benchmarks.bounds displacement [--pairs N] [--out DIR]

Writes bounds_displacement.csv. Pairs are those of `benchmarks.flow simulated` with a peak of 0.4
px. The bound is that of one displacement for all pixels of a window as large as Lucas-Kanade's
(Gaussian weights of standard deviation s stand for 4 pi s^2 pixels), for the noise of the camera
and of rounding; of Horn-Schunck, which has no window, it is for comparison only. The better
textured half of the pixels counts. The ratio is the root mean square of error over bound.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.flow.simulated import KINDS, REFERENCE_FRAMES, Pair, simulate_pairs
from detect.bos import texture_of, unbiased_flow
from detect.differential import horn_schunck, lucas_kanade
from detect.flow import Flow
from detect.registered.information import SLOPE_TAPS
from detect.warp import structure_tensor
from geometry.arrays import FloatMap, GreyImage

PEAK_PX = 0.4
NOISE, NO_NOISE = 1.0, 0.0
WINDOW_PX = 4.0
ROUNDING = 1 / 12
"""Variance of rounding to whole grey levels."""
METHODS: dict[str, Flow] = {"Lucas-Kanade": lucas_kanade, "Horn-Schunck": horn_schunck}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--pairs", type=int, default=4)
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    rows = []
    for kind in KINDS:
        noisy, clean = (
            [pair for pair in simulate_pairs(kind, options.pairs, noise, (), seed=0)
             if pair.peak_px == PEAK_PX]
            for noise in (NOISE, NO_NOISE)
        )  # fmt: skip
        rows += [row(name, kind, flow, noisy, clean) for name, flow in METHODS.items()]
    write_table(options.out / "bounds_displacement.csv", rows)


def row(name: str, kind: str, flow: Flow, noisy: list[Pair], clean: list[Pair]) -> Row:
    still, plume, bounds, alone = ([] for _ in range(4))
    for pair, quiet in zip(noisy, clean, strict=True):
        bound = displacement_bound(pair.reference, WINDOW_PX, noise_variance(REFERENCE_FRAMES))
        squares = squared_error(flow, pair) / bound
        textured = texture_of(pair.reference) >= np.median(texture_of(pair.reference))
        size = np.linalg.norm(pair.truth, axis=-1)
        inside, outside = size > PEAK_PX / 3, size < PEAK_PX / 30
        still.append(squares[textured & outside])
        plume.append(squares[textured & inside])
        bounds.append(bound[textured])
        alone.append(squared_error(flow, quiet)[textured & inside])
    rms = [float(np.sqrt(np.concatenate(one).mean())) for one in (bounds, still, plume, alone)]
    return {
        "flow": name,
        "background": kind,
        "bound, px": f"{rms[0]:.4f}",
        "still air, of the bound": f"{rms[1]:.1f}",
        "plume, of the bound": f"{rms[2]:.1f}",
        "plume without noise, px": f"{rms[3]:.4f}",
    }


def squared_error(flow: Flow, pair: Pair) -> FloatMap:
    found, _ = unbiased_flow(flow, pair.reference, pair.image, texture_of(pair.reference))
    return np.asarray(((found - pair.truth) ** 2).sum(axis=-1))


def noise_variance(others: int) -> float:
    """Of the difference between a frame and the mean of others, grey levels squared."""
    return NOISE**2 * (1 + 1 / others) + 2 * ROUNDING


def slopes(image: GreyImage) -> tuple[FloatMap, FloatMap]:
    """Along x and y, grey levels per px."""
    grey = image.astype(np.float32)
    return cv2.filter2D(grey, -1, SLOPE_TAPS[None]), cv2.filter2D(grey, -1, SLOPE_TAPS[:, None])


def displacement_bound(image: GreyImage, window_px: float, variance: float) -> FloatMap:
    """(H, W) least variance of both components together, px^2.

    Args:
        image: (H, W) what is displaced.
        window_px: Standard deviation of the Gaussian window.
        variance: Of the noise, grey levels squared.
    """
    pixels = 4 * np.pi * window_px**2
    xx, xy, yy = (pixels * term for term in structure_tensor(*slopes(image), window_px))
    return np.asarray(variance * (xx + yy) / np.maximum(xx * yy - xy * xy, 1e-6))
