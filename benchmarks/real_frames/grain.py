"""What full size costs: how much sharpness a displacement by parts of a pixel takes from a frame.

    python -m benchmarks.real_frames grain [RECORDING...]

Prints, for each recording, the share that is lost by shifts of an eighth, a quarter and half a px.
"""

import argparse

import cv2
import numpy as np

from benchmarks.real_frames.cases import add_case_arguments, usable
from geometry.arrays import GreyImage
from locate.recording.images import read_grey
from locate.recording.opening import open_recording
from locate.simulation.photo_overlay import displace_photo
from locate.simulation.scene import ImageBlock

SHIFTS_PX = (0.125, 0.25, 0.5)
BORDER_PX = 8


def sharpness(photo: GreyImage, shift_px: float) -> float:
    """Standard deviation of the Laplacian of a photo that is displaced along both axes."""
    w = np.full((*photo.shape, 2), shift_px, dtype=np.float32)
    moved = displace_photo(photo, w, 1, ImageBlock(noise=0), np.random.default_rng(0))
    inner = cv2.Laplacian(moved.astype(np.float32), cv2.CV_32F)[BORDER_PX:-BORDER_PX]
    return float(inner[:, BORDER_PX:-BORDER_PX].std())


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_case_arguments(parser)


def main(options: argparse.Namespace) -> None:
    for recording in usable(options):
        photos = open_recording(recording).photos
        photo = read_grey(photos[len(photos) // 2])
        still = sharpness(photo, 0.0)
        lost = ", ".join(f"{px:g} px {1 - sharpness(photo, px) / still:.3f}" for px in SHIFTS_PX)
        print(f"{recording.name} | share of sharpness lost: {lost}")
