"""Image messages as every transport carries them, to arrays.

Messages are taken by their fields, so those of rclpy, rosbags and cyclonedds are all read.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from geometry import MOST_PIXELS
from geometry.arrays import GreyImage
from geometry.decoded_size import takes_too_much
from geometry.errors import BadInputError
from geometry.stretch import GREYS, DeepSamples, Samples, Stretch, as_samples, deep_samples
from locate.messages.stamps import NS_PER_S

KEPT_STEP = 4
"""Of an image that set the scale of a live stream, one pixel of so many a side is kept."""
VIDEO_ADVICE = (
    "coded video whose messages do not name H.264, H.265, VP8, VP9 or AV1 is not read; republish "
    "it as raw or JPEG images and record these, or export the video to a file and give that"
)
ENCODINGS = (
    "mono8, mono16, 32FC1, bgr8, rgb8, bgra8, rgba8, bayer_*, yuv422, yuyv, uyvy, nv12, nv21, nv24"
)
"""What is read, for messages."""

_COLOURS = {
    "bgr": cv2.COLOR_BGR2GRAY,
    "rgb": cv2.COLOR_RGB2GRAY,
    "bgra": cv2.COLOR_BGRA2GRAY,
    "rgba": cv2.COLOR_RGBA2GRAY,
}
_MOSAICS = {
    "bayer_rggb": cv2.COLOR_BayerRGGB2GRAY,
    "bayer_bggr": cv2.COLOR_BayerBGGR2GRAY,
    "bayer_gbrg": cv2.COLOR_BayerGBRG2GRAY,
    "bayer_grbg": cv2.COLOR_BayerGRBG2GRAY,
}
_RAW = {"8UC1": "mono8", "8UC3": "bgr8", "8UC4": "bgra8", "16UC1": "mono16", "16UC3": "bgr16"}
_NUMBERS = {"32FC1": "f4", "64FC1": "f8", "8SC1": "i1", "16SC1": "i2", "32SC1": "i4"}
"""Encodings of temperatures and other real numbers, and numpy's names of them."""
_PLANES = {"nv12": (3, 2), "nv21": (3, 2), "nv24": (3, 1)}
"""Rows of bytes over rows of the picture, where the luma comes first as a plane of its own."""
_START_CODES = (b"\0\0\0\1", b"\0\0\1")
"""With which a message of coded video begins."""
_LUMA_FIRST = {
    "yuyv": True,
    "yuv422_yuy2": True,
    "uyvy": False,
    "yuv422": False,
}


class MessageHeader(Protocol):
    """`std_msgs/Header`."""

    stamp: Any
    frame_id: str


class ImageMessage(Protocol):
    """`sensor_msgs/Image`."""

    header: MessageHeader
    height: int
    width: int
    encoding: str
    is_bigendian: Any
    step: int
    data: Any


class CompressedImageMessage(Protocol):
    """`sensor_msgs/CompressedImage`."""

    header: MessageHeader
    format: str
    data: Any


@dataclass
class _Header:
    stamp: Any
    frame_id: str


def header_of(message: Any) -> MessageHeader:
    """The header of an image message; `CompressedVideo` has its fields beside the others."""
    if hasattr(message, "header"):
        header: MessageHeader = message.header
        return header
    return _Header(stamp=message.timestamp, frame_id=message.frame_id)


def read_stamp_ns(header: MessageHeader) -> int:
    """The stamp of a header, ns; the fields of ROS 2 and ROS 1 differ in name."""
    stamp = header.stamp
    seconds = stamp.sec if hasattr(stamp, "sec") else stamp.secs
    rest = stamp.nanosec if hasattr(stamp, "nanosec") else stamp.nsecs
    return int(seconds) * NS_PER_S + int(rest)


class GreyReader:
    """Reads the image messages of one stream in grey.

    Deep samples are shown on one scale, so that the brightness does not flicker from frame to
    frame. That of a live stream is chosen from its first image, and widened when one no longer
    fits it.

    Args:
        stretch: The scale of a recording; None for a live stream.
    """

    def __init__(self, stretch: Stretch | None = None) -> None:
        self._stretch = stretch
        self._is_live = stretch is None
        self._set_by: list[DeepSamples] = []

    def read(self, message: Any) -> GreyImage:
        """The (H, W) uint8 image of an `Image` or a `CompressedImage`.

        Raises:
            BadInputError: The encoding is not known, or the data is not what the header says.
        """
        samples = decode_message(message)
        deep = deep_samples(samples)
        if deep is None:
            return np.ascontiguousarray(samples, dtype=np.uint8)
        return self._in_8_bits(deep)

    def _in_8_bits(self, image: DeepSamples) -> GreyImage:
        if self._stretch is not None and (not self._is_live or self._stretch.fits(image)):
            return self._stretch.apply(image)
        kept = image if image.size < GREYS else image[::KEPT_STEP, ::KEPT_STEP]
        stretch = Stretch.choose([*self._set_by, kept])
        if stretch is None:  # no value is a number
            return np.zeros(image.shape, np.uint8)
        darkest, brightest = float(np.nanmin(image)), float(np.nanmax(image))
        if darkest < brightest:  # of a plain image nothing follows for the next
            self._set_by.append(kept)
            self._stretch = stretch
        return stretch.apply(image)


def decode_message(message: Any) -> Samples:
    """The (H, W) grey samples of an `Image` or a `CompressedImage`.

    Raises:
        BadInputError: See `GreyReader.read`.
    """
    if hasattr(message, "step"):
        return unpack_image(message)
    if hasattr(message, "format"):
        return decompress_image(message)
    raise BadInputError(f"format {message.encoding!r}: {VIDEO_ADVICE}")


def unpack_image(message: ImageMessage) -> Samples:
    """The (H, W) grey samples of an uncompressed image.

    Raises:
        BadInputError: See `GreyReader.read`.
    """
    encoding = _RAW.get(message.encoding, message.encoding)
    if encoding in _NUMBERS:
        return as_samples(_unpack_rows(message, 1, _NUMBERS[encoding])[..., 0])
    if encoding in _LUMA_FIRST:
        pairs = _unpack_rows(message, 2, "u1")
        return np.ascontiguousarray(pairs[..., 0 if _LUMA_FIRST[encoding] else 1])
    if encoding in _PLANES:
        return _unpack_luma_plane(message, *_PLANES[encoding])
    kind, sample = _split_encoding(encoding)
    if kind == "mono":
        return _unpack_rows(message, 1, sample)[..., 0]
    if kind in _MOSAICS:
        mosaic = np.ascontiguousarray(_unpack_rows(message, 1, sample)[..., 0])
        if min(mosaic.shape) < 4:
            raise BadInputError(f"image of {mosaic.shape} is too small for {encoding}")
        return np.asarray(cv2.cvtColor(mosaic, _MOSAICS[kind]))
    if kind in _COLOURS:
        colours = np.ascontiguousarray(_unpack_rows(message, len(kind), sample))
        return np.asarray(cv2.cvtColor(colours, _COLOURS[kind]))
    raise BadInputError(f"image encoding {encoding!r} is not supported, only {ENCODINGS}")


def decompress_image(message: CompressedImageMessage) -> Samples:
    """The (H, W) grey samples of a JPEG or PNG message.

    Raises:
        BadInputError: See `GreyReader.read`.
    """
    if "compresseddepth" in message.format.lower():
        raise BadInputError("compressed depth is no picture; give the topic of a camera")
    data = _as_bytes(message.data)
    if data[:4].tobytes().startswith(_START_CODES):
        raise BadInputError(f"format {message.format!r}: {VIDEO_ADVICE}")
    if takes_too_much(data.tobytes()):
        raise BadInputError("compressed image is too large")
    try:
        image = (
            cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH) if len(data) else None
        )
    except cv2.error as error:
        raise BadInputError(f"compressed image cannot be read ({error.err})") from error
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise BadInputError(f"compressed image ({message.format!r}) cannot be read")
    return np.asarray(image)


def _unpack_luma_plane(message: ImageMessage, parts: int, luma: int) -> NDArray[np.uint8]:
    """The luma of planes of which it is the first.

    The height in the header is that of the picture, or, by some drivers, that of all rows of bytes.

    Args:
        message: The image.
        parts: Rows of bytes of so many rows, ...
        luma: ... are luma.
    """
    height, step, size = int(message.height), int(message.step), len(message.data)
    if size >= step * height * parts // luma:
        return _unpack_rows(message, 1, "u1")[..., 0]
    if height % parts:
        raise BadInputError(
            f"image of {message.width}x{height} px {message.encoding} needs "
            f"{step * height * parts // luma} bytes: data {size} bytes"
        )
    return _unpack_rows(message, 1, "u1")[: height * luma // parts, :, 0]


def _split_encoding(encoding: str) -> tuple[str, str]:
    """Its kind, and numpy's name of its samples."""
    for bits, sample in (("16", "u2"), ("8", "u1")):
        if encoding.endswith(bits):
            return encoding.removesuffix(bits), sample
    return encoding, "u1"


def _as_bytes(data: Any) -> NDArray[np.uint8]:
    if isinstance(data, (list, tuple)):
        return np.asarray(data, dtype=np.uint8)
    return np.frombuffer(data, dtype=np.uint8)


def _unpack_rows(message: ImageMessage, channels: int, sample: str) -> NDArray[Any]:
    """(H, W, channels) samples without the padding of the rows, in the machine's byte order.

    Args:
        message: The image.
        channels: Samples a pixel.
        sample: Numpy's name of their type.
    """
    height, width, step = int(message.height), int(message.width), int(message.step)
    kind = np.dtype(sample).newbyteorder(">" if message.is_bigendian else "<")
    row_bytes = width * channels * kind.itemsize
    data = _as_bytes(message.data)
    if height <= 0 or width <= 0 or height * width > MOST_PIXELS:
        raise BadInputError(f"image of {width}x{height} px has no usable size")
    if step < row_bytes or len(data) < step * (height - 1) + row_bytes:
        raise BadInputError(
            f"image of {width}x{height} px {message.encoding} needs rows of {row_bytes} bytes: "
            f"step is {step}, data {len(data)} bytes"
        )
    rows = np.lib.stride_tricks.as_strided(
        data, shape=(height, row_bytes), strides=(step, 1), writeable=False
    )
    if kind.itemsize == 1:
        return rows.view(kind).reshape(height, width, channels)
    samples = np.ascontiguousarray(rows).view(kind).astype(sample)
    return samples.reshape(height, width, channels)
