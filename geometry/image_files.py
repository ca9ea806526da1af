"""Images from and to files, whatever their names: OpenCV's own calls take names in UTF-8 alone."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from geometry.arrays import GreyImage
from geometry.decoded_size import takes_too_much
from geometry.errors import BadInputError, UnwritableError
from geometry.regular_files import read_content


def read_image(path: Path, flags: int = cv2.IMREAD_GRAYSCALE) -> GreyImage:
    """The (H, W) image of a file in 8 bits of grey.

    Args:
        path: The file.
        flags: As of `cv2.imdecode`; of grey images.

    Raises:
        BadInputError: It is no image, cannot be read, or takes too much memory when decoded.
    """
    try:
        content = read_content(path)
        readable = bool(content) and not takes_too_much(content)
        image = cv2.imdecode(np.frombuffer(content, np.uint8), flags) if readable else None
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
    except cv2.error:
        image = None
    if image is None:
        raise BadInputError(f"{path}: not a readable image; remove or replace it")
    return np.asarray(image, dtype=np.uint8)


def write_image(path: Path, image: np.ndarray, options: Sequence[int] = ()) -> None:
    """Writes a grey or colour image; the suffix of the name says in which format.

    Args:
        path: The file.
        image: (H, W) grey, or (H, W, 3) blue, green, red.
        options: As of `cv2.imencode`.

    Raises:
        BadInputError: It cannot be written.
    """
    try:
        _, content = cv2.imencode(path.suffix, image, options)
        path.write_bytes(content.tobytes())
    except (OSError, cv2.error) as error:
        if isinstance(error, OSError):
            raise UnwritableError.of(path, error) from error
        raise BadInputError(f"{path}: cannot be written (unknown image format)") from error
