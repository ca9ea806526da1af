"""What storing frames does to them."""

from collections.abc import Sequence
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
    return _store(images, fps, H264, bits_per_pixel)


def compress_h265(
    images: Sequence[GreyImage], fps: float, *, bits_per_pixel: float
) -> list[GreyImage]:
    """Likewise as H.265."""
    return _store(images, fps, H265, bits_per_pixel)


def write_coded(
    path: Path, images: Sequence[GreyImage], fps: float, *, codec: str, bits_per_pixel: float
) -> None:
    """Writes the frames as a video of that mean rate, by `H264` or `H265`."""
    height, width = images[0].shape
    options = _rate_options(codec, round(bits_per_pixel * images[0].size * fps))
    with open_video(path, size=(width, height), fps=fps, codec=codec, options=options) as file:
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
) -> list[GreyImage]:
    """The frames after they were coded and decoded."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        write_coded(path, images, fps, codec=codec, bits_per_pixel=bits_per_pixel)
        with av.open(str(path)) as stored:
            frames = (frame.to_ndarray(format="gray") for frame in stored.decode(video=0))
            return [np.asarray(frame, dtype=np.uint8) for frame in frames]
