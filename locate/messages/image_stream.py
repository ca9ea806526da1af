"""The images of one stream of messages: pictures, or coded video that is decoded as it comes."""

from fractions import Fraction
from typing import Any, NamedTuple

import av
import numpy as np

from geometry import MOST_PIXELS
from geometry.arrays import GreyImage
from geometry.errors import BadInputError
from geometry.stretch import Stretch
from locate.messages.codec import GreyReader
from locate.messages.stamps import NS_PER_S

_DECODERS = {
    "h264": "h264",
    "x264": "h264",
    "avc": "h264",
    "h265": "hevc",
    "x265": "hevc",
    "hevc": "hevc",
    "vp8": "vp8",
    "vp9": "vp9",
    "av1": "libdav1d",
}
"""FFmpeg's decoder, by what the name of a format contains."""


class StampedImage(NamedTuple):
    """An (H, W) image and its stamp, ns."""

    stamp_ns: int
    image: GreyImage


class ImageStream:
    """Reads the messages of one stream in grey, in order.

    Args:
        stretch: As of `GreyReader`; coded video keeps the highest 8 bits of its samples.

    Attributes:
        pictureless: How many messages of coded video gave no picture so far: those before the first
            key frame, and those after a damaged one up to the next key frame.
    """

    def __init__(self, stretch: Stretch | None = None) -> None:
        self.pictureless = 0
        self._grey = GreyReader(stretch)
        self._decoder: _VideoDecoder | None = None

    def read(self, message: Any, stamp_ns: int) -> list[StampedImage]:
        """The images that a message completes: one, of coded video sometimes none or several.

        Raises:
            BadInputError: See `GreyReader.read`; or a message of coded video cannot be decoded.
        """
        name = decoder_of(message)
        if name is None:
            return [StampedImage(stamp_ns, self._grey.read(message))]
        if self._decoder is None:
            self._decoder = _VideoDecoder(name)
        self.pictureless += 1
        try:
            return self._count(self._decoder.decode(bytes(memoryview(message.data)), stamp_ns))
        except BadInputError:
            self.pictureless -= 1
            raise

    def finish(self) -> list[StampedImage]:
        """The images that coded video still holds back at its end."""
        return [] if self._decoder is None else self._count(self._decoder.finish())

    def _count(self, images: list[StampedImage]) -> list[StampedImage]:
        self.pictureless -= len(images)
        return images


def decoder_of(message: Any) -> str | None:
    """FFmpeg's decoder of a message of coded video; None of other images."""
    if hasattr(message, "step"):
        return None
    name = message.format if hasattr(message, "format") else message.encoding
    return next((decoder for part, decoder in _DECODERS.items() if part in name.lower()), None)


class _VideoDecoder:
    """Decodes coded video; what follows a damaged picture waits for the next key frame.

    Args:
        name: FFmpeg's decoder.
    """

    def __init__(self, name: str) -> None:
        context = av.CodecContext.create(name, "r")
        assert isinstance(context, av.VideoCodecContext)
        context.thread_count = 1  # threads would hold pictures back
        context.options = {"max_pixels": str(MOST_PIXELS)}
        self._context = context
        self._whole = False

    def decode(self, data: bytes, stamp_ns: int) -> list[StampedImage]:
        packet = av.Packet(data)
        packet.pts, packet.time_base = stamp_ns, Fraction(1, NS_PER_S)
        try:
            frames = self._context.decode(packet)
        except (OSError, ValueError, av.error.FFmpegError) as error:
            self._whole = False
            raise BadInputError(
                "a message of coded video cannot be decoded (damaged, or no key frame before it)"
            ) from error
        return self._whole_images(frames)

    def finish(self) -> list[StampedImage]:
        try:
            return self._whole_images(self._context.decode(None))
        except (OSError, ValueError, av.error.FFmpegError):
            return []

    def _whole_images(self, frames: list[av.VideoFrame]) -> list[StampedImage]:
        images = []
        for frame in frames:
            self._whole = not frame.is_corrupt and (self._whole or frame.key_frame)
            if self._whole and frame.pts is not None:
                grey = np.asarray(frame.to_ndarray(format="gray"), dtype=np.uint8)
                images.append(StampedImage(frame.pts, grey))
        return images
