"""Image messages as every transport carries them, to arrays.

Messages are taken by their fields, so those of rclpy, rosbags and cyclonedds all serve.
"""

from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from geometry.arrays import GreyImage
from geometry.errors import BadInputError
from locate.messages.poses import NS_PER_S

MOST_PIXELS = 1 << 28
"""Larger images are refused: a damaged header must not fill the memory (chosen)."""
FEWEST_BITS, MOST_BITS = 10, 16
"""Bits that a camera with 16-bit samples uses."""

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

    Of 16-bit samples it keeps the 8 bits below the highest that the stream has ever used (10, 12,
    14 or 16), so that the brightness does not flicker from frame to frame.
    """

    def __init__(self) -> None:
        self._bits = FEWEST_BITS

    def read(self, message: Any) -> GreyImage:
        """The (H, W) uint8 image of an `Image` or a `CompressedImage`.

        Raises:
            BadInputError: The encoding is not known, or the data does not fit the header.
        """
        image = decompress_image(message) if hasattr(message, "format") else unpack_image(message)
        return self._in_8_bits(image)

    def _in_8_bits(self, image: NDArray[np.uint8] | NDArray[np.uint16]) -> GreyImage:
        if image.dtype == np.uint8:
            return np.ascontiguousarray(image, dtype=np.uint8)
        used = int(image.max(initial=0)).bit_length()
        self._bits = min(max(self._bits, 2 * -(-used // 2)), MOST_BITS)
        return np.asarray(image >> (self._bits - 8), dtype=np.uint8)


def unpack_image(message: ImageMessage) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The (H, W) grey samples of an uncompressed image, uint8 or native uint16.

    Raises:
        BadInputError: See `GreyReader.read`.
    """
    encoding = _RAW.get(message.encoding, message.encoding)
    if encoding in _LUMA_FIRST:
        pairs = _unpack_rows(message, channels=2, bits=8)
        return np.ascontiguousarray(pairs[..., 0 if _LUMA_FIRST[encoding] else 1])
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
    raise BadInputError(f"image encoding {message.encoding!r} is not supported")


def decompress_image(message: CompressedImageMessage) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The (H, W) grey samples of a JPEG or PNG message.

    Raises:
        BadInputError: See `GreyReader.read`.
    """
    if "compresseddepth" in message.format.lower():
        raise BadInputError("compressed depth is no picture; give the topic of a camera")
    data = _as_bytes(message.data)
    try:
        image = (
            cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH) if len(data) else None
        )
    except cv2.error as error:
        raise BadInputError(f"compressed image cannot be read ({error.err})") from error
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise BadInputError(f"compressed image ({message.format!r}) cannot be read")
    return np.asarray(image)


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
