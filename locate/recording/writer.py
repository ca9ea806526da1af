"""A video file, written frame by frame."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

LOSSLESS = "ffv1"
H264, H265 = "libx264", "libx265"
FALLBACK = "mpeg4"
"""Codec where the one asked for is not built in."""
FINEST_RATE = 1001
"""Largest denominator of a frame rate: 30000/1001 is the finest in use."""


class VideoWriter:
    """Takes frames one after the other; made by `create_video`."""

    def __init__(self, container: Any, stream: Any) -> None:
        self._container = container
        self._stream = stream
        self._count = 0

    def write(self, image: NDArray[np.uint8]) -> None:
        """Appends a frame: (H, W) grey, or (H, W, 3) blue, green, red."""
        height, width = self._stream.height, self._stream.width
        image = np.ascontiguousarray(image[:height, :width])
        frame = av.VideoFrame.from_ndarray(image, format="gray" if image.ndim == 2 else "bgr24")
        frame.pts = self._count
        frame.time_base = self._stream.codec_context.time_base
        self._count += 1
        if self._stream.pix_fmt != frame.format.name:
            frame = frame.reformat(format=self._stream.pix_fmt)
        self._container.mux(self._stream.encode(frame))


@contextmanager
def create_video(
    path: Path,
    *,
    size: tuple[int, int],
    fps: float,
    codec: str = H264,
    options: Mapping[str, str] | None = None,
) -> Iterator[VideoWriter]:
    """Creates a video file, which is complete when the block ends.

    Args:
        path: Its suffix names the container.
        size: Width and height, px; an odd last row or column is left out unless lossless.
        fps: Frames per second.
        codec: `LOSSLESS` (grey), `H264` or `H265`; MPEG-4 replaces one that is not built in.
        options: For the codec.
    """
    rate = Fraction(fps).limit_denominator(FINEST_RATE)
    if codec not in av.codecs_available:
        codec, options = FALLBACK, {}
    even = 1 if codec == LOSSLESS else 2
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(codec, rate=rate)
        stream.width, stream.height = (side - side % even for side in size)
        stream.pix_fmt = "gray" if codec == LOSSLESS else "yuv420p"
        stream.codec_context.time_base = 1 / rate
        stream.options = dict(options or {})
        yield VideoWriter(container, stream)
        container.mux(stream.encode())
