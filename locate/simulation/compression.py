"""What storing frames does to them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import cv2
import numpy as np

from geometry.arrays import GreyImage
from locate.recording.writer import H264, H265, open_video


def compress_jpeg(images: Sequence[GreyImage], _fps: float, *, quality: int) -> list[GreyImage]:
    """The frames as JPEG files of that quality, 1 to 100."""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    files = [cv2.imencode(".jpg", image, options)[1] for image in images]
    return [np.asarray(cv2.imdecode(file, cv2.IMREAD_GRAYSCALE), np.uint8) for file in files]


def compress_h264(
    images: Sequence[GreyImage], fps: float, *, bits_per_pixel: float
) -> list[GreyImage]:
    """The frames as an H.264 video of that mean rate, from an encoder with a steady hand."""
    rate = str(_bit_rate(images, fps, bits_per_pixel))
    options = {"b": rate, "maxrate": rate, "bufsize": rate, "threads": "1"}
    return _store(images, fps, H264, options)


def compress_h265(
    images: Sequence[GreyImage], fps: float, *, bits_per_pixel: float
) -> list[GreyImage]:
    """Likewise as H.265."""
    rate = _bit_rate(images, fps, bits_per_pixel)
    steady = f"vbv-maxrate={rate // 1000}:vbv-bufsize={rate // 1000}"
    threads = "pools=none:frame-threads=1:log-level=error"
    return _store(images, fps, H265, {"b": str(rate), "x265-params": f"{steady}:{threads}"})


def _bit_rate(images: Sequence[GreyImage], fps: float, bits_per_pixel: float) -> int:
    """Bits a second."""
    return round(bits_per_pixel * images[0].size * fps)


def _store(
    images: Sequence[GreyImage], fps: float, codec: str, options: Mapping[str, str]
) -> list[GreyImage]:
    """The frames after they were coded and decoded."""
    height, width = images[0].shape
    with TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        with open_video(path, size=(width, height), fps=fps, codec=codec, options=options) as file:
            for image in images:
                file.write(image)
        with av.open(str(path)) as stored:
            frames = (frame.to_ndarray(format="gray") for frame in stored.decode(video=0))
            return [np.asarray(frame, dtype=np.uint8) for frame in frames]
