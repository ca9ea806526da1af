"""Image messages as every transport carries them, to arrays.

Messages are taken by their fields, so those of rclpy, rosbags and cyclonedds all serve.
"""

import re
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from geometry import MOST_PIXELS
from geometry.arrays import GreyImage
from geometry.decoded_size import takes_too_much
from geometry.errors import BadInputError
from geometry.stretch import GREYS, Stretch
from locate.messages.stamps import NS_PER_S

KEPT_STEP = 4
"""Of an image that set the scale of a live stream, one pixel of so many a side is kept."""
VIDEO_ADVICE = (
    "coded video (H.264, H.265, ...) in messages is not read; republish it as raw or JPEG images "
    "and record these, or export the video to a file and give that"
)
FLOAT_ADVICE = (
    "is no picture but floating-point or signed values (depth, temperature); convert the topic to "
    "mono16 with one scale for all images and record again"
)
ENCODINGS = "mono8, mono16, bgr8, rgb8, bgra8, rgba8, bayer_*, yuv422, yuyv, uyvy, nv12, nv21, nv24"
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
_PLANES = {"nv12": (3, 2), "nv21": (3, 2), "nv24": (3, 1)}
"""Rows of bytes over rows of the picture, where the luma comes first as a plane of its own."""
_VIDEO_FORMATS = ("h264", "h265", "hevc", "avc", "av1", "vp8", "vp9", "theora", "mpeg4")
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


def read_stamp_ns(header: MessageHeader) -> int:
    """The stamp of a header, ns; the fields of ROS 2 and ROS 1 differ in name."""
    stamp = header.stamp
    seconds = stamp.sec if hasattr(stamp, "sec") else stamp.secs
    rest = stamp.nanosec if hasattr(stamp, "nanosec") else stamp.nsecs
    return int(seconds) * NS_PER_S + int(rest)


class GreyReader:
    """Reads the image messages of one stream in grey.

    16-bit samples are shown on one scale, so that the brightness does not flicker from frame to
    frame. That of a live stream is chosen from its first image, and widened when one no longer
    fits it.

    Args:
        stretch: The scale of a recording; None for a live stream.
    """

    def __init__(self, stretch: Stretch | None = None) -> None:
        self._stretch = stretch
        self._is_live = stretch is None
        self._set_by: list[NDArray[np.uint16]] = []

    def read(self, message: Any) -> GreyImage:
        """The (H, W) uint8 image of an `Image` or a `CompressedImage`.

        Raises:
            BadInputError: The encoding is not known, or the data is not what the header says.
        """
        samples = read_samples(message)
        if samples.dtype == np.uint8:
            return np.ascontiguousarray(samples, dtype=np.uint8)
        return self._in_8_bits(samples.astype(np.uint16, copy=False))

    def _in_8_bits(self, image: NDArray[np.uint16]) -> GreyImage:
        if self._stretch is not None and (not self._is_live or self._stretch.fits(image)):
            return self._stretch.apply(image)
        kept = image if image.size < GREYS else image[::KEPT_STEP, ::KEPT_STEP]
        stretch = Stretch.choose([*self._set_by, kept])
        assert stretch is not None
        if image.min() < image.max():  # a plain image says nothing of the next
            self._set_by.append(kept)
            self._stretch = stretch
        return stretch.apply(image)


def read_samples(message: Any) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The (H, W) grey samples of an `Image` or a `CompressedImage`, uint8 or native uint16.

    Raises:
        BadInputError: See `GreyReader.read`.
    """
    return decompress_image(message) if hasattr(message, "format") else unpack_image(message)


def unpack_image(message: ImageMessage) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The (H, W) grey samples of an uncompressed image, uint8 or native uint16.

    Raises:
        BadInputError: See `GreyReader.read`.
    """
    encoding = _RAW.get(message.encoding, message.encoding)
    if encoding in _LUMA_FIRST:
        pairs = _unpack_rows(message, channels=2, bits=8)
        return np.ascontiguousarray(pairs[..., 0 if _LUMA_FIRST[encoding] else 1])
    if encoding in _PLANES:
        return _unpack_luma_plane(message, *_PLANES[encoding])
    kind, bits = _split_encoding(encoding)
    if kind == "mono":
        return _unpack_rows(message, channels=1, bits=bits)[..., 0]
    if kind in _MOSAICS:
        mosaic = np.ascontiguousarray(_unpack_rows(message, channels=1, bits=bits)[..., 0])
        if min(mosaic.shape) < 4:
            raise BadInputError(f"image of {mosaic.shape} is too small for {encoding}")
        return np.asarray(cv2.cvtColor(mosaic, _MOSAICS[kind]))
    if kind in _COLOURS:
        colours = np.ascontiguousarray(_unpack_rows(message, channels=len(kind), bits=bits))
        return np.asarray(cv2.cvtColor(colours, _COLOURS[kind]))
    if re.fullmatch(r"(32|64)FC\d+|(8|16|32)SC\d+", encoding):
        raise BadInputError(f"image encoding {encoding} {FLOAT_ADVICE}")
    raise BadInputError(f"image encoding {encoding!r} is not supported, only {ENCODINGS}")


def decompress_image(message: CompressedImageMessage) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The (H, W) grey samples of a JPEG or PNG message.

    Raises:
        BadInputError: See `GreyReader.read`.
    """
    if "compresseddepth" in message.format.lower():
        raise BadInputError("compressed depth is no picture; give the topic of a camera")
    data = _as_bytes(message.data)
    coded = any(name in message.format.lower() for name in _VIDEO_FORMATS)
    if coded or data[:4].tobytes().startswith(_START_CODES):
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
        return _unpack_rows(message, channels=1, bits=8)[..., 0]
    if height % parts:
        raise BadInputError(
            f"image of {message.width}x{height} px {message.encoding} needs "
            f"{step * height * parts // luma} bytes: data {size} bytes"
        )
    return _unpack_rows(message, channels=1, bits=8)[: height * luma // parts, :, 0]


def _split_encoding(encoding: str) -> tuple[str, int]:
    for bits in (16, 8):
        if encoding.endswith(str(bits)):
            return encoding.removesuffix(str(bits)), bits
    return encoding, 8


def _as_bytes(data: Any) -> NDArray[np.uint8]:
    if isinstance(data, (list, tuple)):
        return np.asarray(data, dtype=np.uint8)
    return np.frombuffer(data, dtype=np.uint8)


def _unpack_rows(message: ImageMessage, *, channels: int, bits: int) -> NDArray[Any]:
    """(H, W, channels) samples without the padding of the rows, in the machine's byte order."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    row_bytes = width * channels * (bits // 8)
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
    if bits == 8:
        return rows.reshape(height, width, channels)
    order = ">u2" if message.is_bigendian else "<u2"
    samples = np.ascontiguousarray(rows).view(order).astype(np.uint16)
    return samples.reshape(height, width, channels)
