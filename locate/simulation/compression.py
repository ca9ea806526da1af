"""What storing frames does to them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import cv2
import numpy as np
from av.video.frame import PictureType

from detect.synthesis.sample import log_uniform
from geometry.arrays import GreyImage, IntArray
from locate.recording.writer import H264, H265, create_video

VIDEO_BITS_PER_PIXEL = (0.1, 0.5)
"""What cameras spend on a video."""


@dataclass(frozen=True, kw_only=True)
class CodedFrames:
    """Frames as a file gives them back.

    Attributes:
        images: All of them.
        b_frames: Rows of the B frames.
    """

    images: list[GreyImage]
    b_frames: IntArray


FrameCoding = Callable[[Sequence[GreyImage], float], CodedFrames]
"""Stores frames and reads them again, given frames per second."""


def draw_video_coding(rng: np.random.Generator) -> FrameCoding:
    """H.264 or H.265 of `VIDEO_BITS_PER_PIXEL`."""
    compress = compress_h265 if rng.random() < 0.5 else compress_h264
    return partial(compress, bits_per_pixel=log_uniform(rng, VIDEO_BITS_PER_PIXEL))


def compress_jpeg(images: Sequence[GreyImage], _fps: float, *, quality: int) -> CodedFrames:
    """The frames as JPEG files of that quality, 1 to 100."""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    files = [cv2.imencode(".jpg", image, options)[1] for image in images]
    decoded = [np.asarray(cv2.imdecode(file, cv2.IMREAD_GRAYSCALE), np.uint8) for file in files]
    return CodedFrames(images=decoded, b_frames=np.empty(0, np.int64))


def compress_h264(images: Sequence[GreyImage], fps: float, *, bits_per_pixel: float) -> CodedFrames:
    """The frames as an H.264 video of that mean rate, from an encoder with a steady hand."""
    return _store(images, fps, H264, bits_per_pixel)


def compress_h265(images: Sequence[GreyImage], fps: float, *, bits_per_pixel: float) -> CodedFrames:
    """Likewise as H.265."""
    return _store(images, fps, H265, bits_per_pixel)


def write_coded(
    path: Path, images: Sequence[GreyImage], fps: float, *, codec: str, bits_per_pixel: float
) -> None:
    """Writes the frames as a video of that mean rate, by `H264` or `H265`."""
    height, width = images[0].shape
    options = _rate_options(codec, round(bits_per_pixel * images[0].size * fps))
    with create_video(path, size=(width, height), fps=fps, codec=codec, options=options) as file:
        for image in images:
            file.write(image)


def _rate_options(codec: str, rate: int) -> dict[str, str]:
    """For so many bits a second."""
    if codec == H265:
        steady = f"vbv-maxrate={rate // 1000}:vbv-bufsize={rate // 1000}"
        threads = "pools=none:frame-threads=1:log-level=error"
        return {"b": str(rate), "x265-params": f"{steady}:{threads}"}
    return {"b": str(rate), "maxrate": str(rate), "bufsize": str(rate), "threads": "1"}


def _store(
    images: Sequence[GreyImage], fps: float, codec: str, bits_per_pixel: float
) -> CodedFrames:
    """The frames after they were coded and decoded."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        write_coded(path, images, fps, codec=codec, bits_per_pixel=bits_per_pixel)
        with av.open(str(path)) as stored:
            decoded, types = [], []
            for frame in stored.decode(video=0):
                decoded.append(np.asarray(frame.to_ndarray(format="gray"), dtype=np.uint8))
                types.append(frame.pict_type)
    b_frames = np.flatnonzero([each == PictureType.B for each in types])
    return CodedFrames(images=decoded, b_frames=b_frames)
