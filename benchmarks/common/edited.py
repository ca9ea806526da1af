"""A rendered recording as others might film it: compressed, coming back, turned too fast."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from geometry.arrays import GreyImage, IntArray
from geometry.trajectory import Trajectory
from locate.recording import open_recording
from locate.recording.writer import LOSSLESS, create_video
from locate.simulation.compression import compress_h264

FPS = 15.0
BITS_PER_PIXEL = 0.15
EDITS: dict[str, Callable[[IntArray], IntArray]] = {
    "h264": lambda rows: rows,
    "there-and-back": lambda rows: np.concatenate([rows[::2], rows[:0:-2]]),
    "fast-turn": lambda rows: np.concatenate(np.array_split(rows, 3)[::2]),
}
"""The frames that an edit keeps, in their new order; `h264` codes them at `BITS_PER_PIXEL`."""


def video_of(folder: Path) -> Path:
    """The video of a rendered recording.

    Args:
        folder: Holds one video, and truth.json.
    """
    return next(folder.glob("*.m[kp][v4]"))


def write_edited(source: Path, edit: str, folder: Path) -> None:
    """Writes an edited recording, losslessly, and the truth about it.

    Args:
        source: The rendered recording: a video and truth.json.
        edit: A key of `EDITS`.
        folder: Where video.mkv and truth.json go.
    """
    every = [frame.image for frame in open_recording(video_of(source)).frames()]
    rows = EDITS[edit](np.arange(len(every)))
    images: list[GreyImage] = [every[row] for row in rows]
    if edit == "h264":
        images = compress_h264(images, FPS, bits_per_pixel=BITS_PER_PIXEL).images
    height, width = images[0].shape
    folder.mkdir(parents=True, exist_ok=True)
    with create_video(folder / "video.mkv", size=(width, height), fps=FPS, codec=LOSSLESS) as video:
        for image in images:
            video.write(image)
    truth = Trajectory.load(source / "truth.json").take(rows)
    count = np.arange(len(rows))
    replace(truth, indices=count, times_s=count / FPS).save(folder / "truth.json")
