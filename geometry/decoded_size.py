"""How much memory an image takes while it is decoded, by what its file declares."""

import re
import struct

MOST_DECODED_BYTES = 2**30
"""OpenCV takes up to twice as much until the grey image is made."""
_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
"""By the type of colour."""
_JPEG_2000_STARTS = (b"\0\0\0\x0cjP  \r\n\x87\n", b"\xff\x4f\xff\x51")
_JPEG_2000 = re.compile(rb"\xff\x4f\xff\x51(?=(.{38}))", re.DOTALL)
"""Where a codestream begins, and the header that follows."""
_BYTES_PER_VALUE = 4
"""Of JPEG 2000 while it is decoded, however deep it is."""


def takes_too_much(content: bytes) -> bool:
    """Whether a PNG or JPEG 2000 file would take more than `MOST_DECODED_BYTES`.

    OpenCV limits pixels, but keeps all channels of these at their depth before it makes grey of
    them. Other formats are decoded row by row, or have 8 bits.
    """
    return _declared_bytes(content) > MOST_DECODED_BYTES


def _declared_bytes(content: bytes) -> int:
    if content.startswith(_PNG) and len(content) >= 26:
        width, height, bits, colour = struct.unpack_from(">IIBB", content, 16)
        return int(width * height * _PNG_CHANNELS.get(colour, 4) * max(bits, 8) // 8)
    if content.startswith(_JPEG_2000_STARTS):
        return max(map(_jpeg_2000_bytes, _JPEG_2000.finditer(content)), default=0)
    return 0


def _jpeg_2000_bytes(found: re.Match[bytes]) -> int:
    right, bottom, left, top = struct.unpack_from(">4I", found[1], 4)
    (channels,) = struct.unpack_from(">H", found[1], 36)
    return int(max(right - left, 0) * max(bottom - top, 0) * channels * _BYTES_PER_VALUE)
