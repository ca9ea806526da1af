"""What storing frames does to them."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import cv2
import numpy as np

from geometry.arrays import GreyImage
from locate.recording.writer import H264, open_video


def compress_jpeg(images: Sequence[GreyImage], _fps: float, *, quality: int) -> list[GreyImage]:
    """The frames as JPEG files of that quality, 1 to 100."""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    files = [cv2.imencode(".jpg", image, options)[1] for image in images]
    return [np.asarray(cv2.imdecode(file, cv2.IMREAD_GRAYSCALE), np.uint8) for file in files]


def compress_h264(
    images: Sequence[GreyImage], fps: float, *, bits_per_pixel: float
) -> list[GreyImage]:
    """The frames as an H.264 video of that mean rate, from an encoder with a steady hand."""
    height, width = images[0].shape
    rate = round(bits_per_pixel * width * height * fps)
    options = {"b": str(rate), "maxrate": str(rate), "bufsize": str(rate), "threads": "1"}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        with open_video(path, size=(width, height), fps=fps, codec=H264, options=options) as file:
            for image in images:
                file.write(image)
        with av.open(str(path)) as stored:
            frames = (frame.to_ndarray(format="gray") for frame in stored.decode(video=0))
            return [np.asarray(frame, dtype=np.uint8) for frame in frames]
