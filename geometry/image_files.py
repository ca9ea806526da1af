"""Images from and to files, whatever their names: OpenCV's own calls take names in UTF-8 alone."""

from pathlib import Path

import cv2
import numpy as np

from geometry.decoded_size import takes_too_much
from geometry.errors import BadInputError, describe_error
from geometry.regular_files import read_content


def read_image(path: Path, flags: int = cv2.IMREAD_GRAYSCALE) -> np.ndarray | None:
    """The image of a file; None where it is none or cannot be read.

    Args:
        path: The file.
        flags: As of `cv2.imdecode`.
    """
    try:
        content = read_content(path)
        if not content or takes_too_much(content):
            return None
        return cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except (OSError, cv2.error):
        return None


def write_image(path: Path, image: np.ndarray) -> None:
    """Writes a grey or colour image; the suffix of the name says in which format.

    Raises:
        BadInputError: It cannot be written.
    """
    try:
        _, content = cv2.imencode(path.suffix, image)
        path.write_bytes(content.tobytes())
    except (OSError, cv2.error) as error:
        reason = describe_error(error) if isinstance(error, OSError) else "unknown image format"
        raise BadInputError(f"{path}: cannot be written ({reason})") from error
