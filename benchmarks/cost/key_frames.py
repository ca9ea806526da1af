"""CPU s for each frame of a video, to decode it and choose its key frames.

    python -m benchmarks.cost key-frames

The videos are H.264 of a moving grey texture, made on the spot. Prints a row for each size.
"""

import argparse
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from geometry.arrays import GreyImage
from locate.recording import open_recording, select_frames
from locate.recording.writer import create_video

SIZES = ((1920, 1080, 90), (3840, 2160, 45))


def add_arguments(_parser: argparse.ArgumentParser) -> None:
    """There are none."""


def main(_options: argparse.Namespace) -> None:
    ground = texture(np.random.default_rng(0))
    print("size | frames | Mbit/s | key frames | CPU s a frame")
    for width, height, count in SIZES:
        with tempfile.TemporaryDirectory() as folder:
            path, kept = Path(folder) / "video.mp4", Path(folder) / "frames"
            kept.mkdir()
            write_flight(path, ground, (width, height), count)
            start = time.process_time()
            frames = select_frames(open_recording(path, max_side=1280), kept, max_frames=120)
            spent = (time.process_time() - start) / count
            rate = path.stat().st_size * 8 * 30 / count / 1e6
            print(f"{width}x{height} | {count} | {rate:.1f} | {len(frames)} | {spent:.3f}")


def write_flight(path: Path, ground: GreyImage, size: tuple[int, int], count: int) -> None:
    """Writes a video of `count` frames of a camera that moves evenly over the ground."""
    width, height = size
    options = {"crf": "20", "preset": "veryfast"}
    with create_video(path, size=size, fps=30, options=options) as video:
        for i in range(count):
            view = ground[200 + 3 * i : 200 + 3 * i + height, 6 * i : 6 * i + width]
            video.write(cv2.cvtColor(view, cv2.COLOR_GRAY2BGR))


def texture(rng: np.random.Generator) -> GreyImage:
    """Ground with detail of two sizes."""
    coarse = rng.uniform(30, 220, (600, 900)).astype(np.float32)
    fine = rng.normal(0, 12, (1920, 2880)).astype(np.float32)
    ground = cv2.resize(coarse, (5760, 3840), interpolation=cv2.INTER_CUBIC)
    ground += cv2.resize(fine, (5760, 3840))
    return np.asarray(np.clip(ground, 0, 255), dtype=np.uint8)
