"""Boards that a lens is calibrated by, and their corners in pictures."""

import re
from typing import Any, NamedTuple, Self

import cv2
import numpy as np

from geometry.arrays import FloatArray, GreyImage
from geometry.errors import BadInputError

SYNTAX = "COLUMNSxROWS of inner corners (9x6), or charuco:DICTIONARY:COLUMNSxROWS[:SHARE] of fields"
USUAL_SHARE = 0.75
"""Side of a marker over that of its field."""
FEWEST_CORNERS = 12
"""Of a ChArUco board in one picture."""
_CHESSBOARD = re.compile(r"(\d{1,3})x(\d{1,3})")
_CHARUCO = re.compile(r"charuco:(\w{3,30}):(\d{1,3})x(\d{1,3})(?::(0?\.\d{1,6}))?", re.IGNORECASE)


class Corners(NamedTuple):
    """Corners that were found.

    Attributes:
        on_board: (N, 2) places on the board, in fields.
        in_image: (N, 2) px.
    """

    on_board: FloatArray
    in_image: FloatArray


class CalibrationBoard:
    """A chessboard or a ChArUco board.

    Args:
        columns: Of inner corners; of fields of a ChArUco board.
        rows: Likewise.
        charuco: Detector of OpenCV and its board; None for a chessboard.
    """

    def __init__(self, columns: int, rows: int, charuco: Any = None) -> None:
        self._shape = (columns, rows)
        self._charuco = charuco
        y, x = np.mgrid[:rows, :columns]
        self._places = np.column_stack([x.ravel(), y.ravel()]).astype(float)

    @classmethod
    def parse(cls, text: str) -> Self:
        """The board that a text such as ``9x6`` or ``charuco:4X4_50:7x5`` describes.

        Raises:
            BadInputError: It describes none.
        """
        plain, charuco = _CHESSBOARD.fullmatch(text), _CHARUCO.fullmatch(text)
        match = plain or charuco
        sizes = [] if match is None else [int(n) for n in match.groups()[-2 if plain else 1 :][:2]]
        if not sizes or min(sizes) < 3:
            raise BadInputError(f"--board {text}: expected {SYNTAX}, at least 3 each way")
        columns, rows = sizes
        if charuco is None:
            return cls(columns, rows)
        dictionary = getattr(cv2.aruco, f"DICT_{charuco[1].upper()}", None)
        if dictionary is None:
            raise BadInputError(f"--board {text}: OpenCV has no dictionary {charuco[1]}")
        share = float(charuco[4] or USUAL_SHARE)
        markers = cv2.aruco.getPredefinedDictionary(dictionary)
        held, needed = len(markers.bytesList), columns * rows // 2
        if needed > held:
            raise BadInputError(
                f"--board {text}: needs {needed} markers, the dictionary has {held}"
            )
        try:
            board = cv2.aruco.CharucoBoard(sizes, 1.0, share, markers)
            return cls(columns, rows, cv2.aruco.CharucoDetector(board))
        except cv2.error as error:
            raise BadInputError(f"--board {text}: not a board that OpenCV can make") from error

    def find(self, image: GreyImage) -> Corners | None:
        """Its corners in a picture; None where it is not seen, or not enough of it."""
        if self._charuco is None:
            found, in_image = cv2.findChessboardCornersSB(
                image, self._shape, flags=cv2.CALIB_CB_NORMALIZE_IMAGE
            )
            return Corners(self._places, in_image.reshape(-1, 2).astype(float)) if found else None
        in_image, ids, _, _ = self._charuco.detectBoard(image)
        if ids is None or len(ids) < FEWEST_CORNERS:
            return None
        places = self._charuco.getBoard().getChessboardCorners()[np.ravel(ids), :2]
        return Corners(np.asarray(places, dtype=float), in_image.reshape(-1, 2).astype(float))
