"""Photos from bytes to samples: by OpenCV, or by libraries that are extras (HEIC, raw)."""

from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from geometry import MOST_PIXELS
from geometry.decoded_size import takes_too_much
from geometry.errors import BadInputError, report_as_bad_input
from geometry.regular_files import read_content
from locate.recording.formats import READ, TOO_LARGE, PhotoKind, kind_of_photo

EXTRAS = {PhotoKind.HEIF: ("pi_heif", "heif"), PhotoKind.RAW: ("rawpy", "raw")}
"""Module and extra by which a kind is decoded."""
_OTHERWISE = {
    PhotoKind.HEIF: "convert them to JPEG (heif-convert IN.heic OUT.jpg)",
    PhotoKind.RAW: "develop them to 16-bit TIFF, all alike (dcraw_emu -6 -T FILE)",
}
_SIDEWAYS = (5, 6)
"""Values of LibRaw's flip that swap the sides."""


def missing_extra(kind: PhotoKind) -> str | None:
    """What to install, or to do instead, to read photos of a kind; None where they can be read."""
    if kind not in EXTRAS or find_spec(EXTRAS[kind][0]) is not None:
        return None
    return f"pip install 'plume-locate[{EXTRAS[kind][1]}]', or {_OTHERWISE[kind]}"


def decode_samples(path: Path, content: bytes) -> NDArray[Any]:
    """The (H, W) samples of a photo in grey, upright, as deep as they are stored.

    Raw photos are developed to 16 bits with the camera's white balance and without brightening,
    so that photos of one exposure stay alike.

    Args:
        path: For messages, and for its suffix.
        content: The whole file.

    Raises:
        BadInputError: It cannot be decoded, its extra is missing, or it is too large.
    """
    kind = kind_of_photo(path, content)
    if kind is PhotoKind.PLAIN:
        return _decode_plain(path, content)
    with report_as_bad_input(path, kind.value, missing=missing_extra(kind)):
        return _decode_heif(path, content) if kind is PhotoKind.HEIF else _develop(path, content)


def photo_size(path: Path, *, reduced: bool = False) -> tuple[int, int] | None:
    """Width and height as shown, px; None where the photo cannot be read.

    Args:
        path: The photo.
        reduced: An eighth of them is enough, which is fast to decode.
    """
    try:
        content = read_content(path)
        kind = kind_of_photo(path, content)
        if kind is PhotoKind.PLAIN:
            mode = cv2.IMREAD_REDUCED_GRAYSCALE_8 if reduced else cv2.IMREAD_GRAYSCALE
            if not content or takes_too_much(content):
                return None
            image = cv2.imdecode(np.frombuffer(content, np.uint8), mode)
            factor = 8 if reduced else 1
            return None if image is None else (image.shape[1] * factor, image.shape[0] * factor)
        with report_as_bad_input(path, kind.value, missing=missing_extra(kind)):
            return _heif_size(content) if kind is PhotoKind.HEIF else _raw_size(content)
    except (OSError, cv2.error, BadInputError):
        return None


def heif_exif(path: Path) -> bytes:
    """The EXIF block of a HEIC photo; empty where it has none or cannot be read."""
    try:
        content = read_content(path)
        with report_as_bad_input(path, PhotoKind.HEIF.value):
            return bytes(_open_heif(content).info.get("exif") or b"")
    except (OSError, BadInputError):
        return b""


def _decode_plain(path: Path, content: bytes) -> NDArray[Any]:
    if takes_too_much(content):
        raise BadInputError(f"{path}: {TOO_LARGE}")
    try:
        given = np.frombuffer(content, dtype=np.uint8)
        image = cv2.imdecode(given, cv2.IMREAD_ANYDEPTH) if content else None
    except cv2.error as error:
        raise BadInputError(f"{path}: {reason_of(error)}") from error
    if image is None:
        raise BadInputError(f"{path}: not a readable image ({READ}); remove or replace it")
    return np.asarray(image)


def reason_of(error: cv2.error) -> str:
    """Why OpenCV refuses an image, in a few words."""
    return TOO_LARGE if "MAX_IMAGE_PIXELS" in error.err else f"cannot be read ({error.err})"


def _decode_heif(path: Path, content: bytes) -> NDArray[Any]:
    photo = _open_heif(content)
    _check_pixels(path, photo.size)
    return _grey(np.asarray(photo))


def _heif_size(content: bytes) -> tuple[int, int]:
    width, height = _open_heif(content).size
    return int(width), int(height)


def _open_heif(content: bytes) -> Any:
    import pi_heif

    return pi_heif.open_heif(BytesIO(content), convert_hdr_to_8bit=False)


def _develop(path: Path, content: bytes) -> NDArray[Any]:
    import rawpy

    with rawpy.RawPy() as photo:
        photo.open_buffer(BytesIO(content))
        _check_pixels(path, (photo.sizes.raw_width, photo.sizes.raw_height))
        photo.unpack()
        return _grey(photo.postprocess(output_bps=16, no_auto_bright=True, use_camera_wb=True))


def _raw_size(content: bytes) -> tuple[int, int]:
    import rawpy

    with rawpy.RawPy() as photo:
        photo.open_buffer(BytesIO(content))
        width, height = int(photo.sizes.width), int(photo.sizes.height)
        return (height, width) if photo.sizes.flip in _SIDEWAYS else (width, height)


def _check_pixels(path: Path, size: tuple[int, int]) -> None:
    if size[0] * size[1] > MOST_PIXELS:
        raise BadInputError(f"{path}: {TOO_LARGE}")


def _grey(samples: NDArray[Any]) -> NDArray[Any]:
    """(H, W) of (H, W) or (H, W, 1, 3 or 4); alpha is ignored."""
    if samples.ndim == 2 or samples.shape[2] < 3:
        return np.ascontiguousarray(samples if samples.ndim == 2 else samples[..., 0])
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(samples[..., :3]), cv2.COLOR_RGB2GRAY))
