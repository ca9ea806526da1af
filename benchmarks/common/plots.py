"""Drawing with OpenCV: text, in panels that are stacked into one picture."""

import cv2
import numpy as np

Colour = tuple[int, int, int]
GREY = (60, 60, 60)


def text(image: np.ndarray, words: str, at: tuple[int, int], colour: Colour = GREY) -> None:
    cv2.putText(image, words, at, cv2.FONT_HERSHEY_SIMPLEX, 0.38, colour, 1, cv2.LINE_AA)


def blank(height: int, width: int) -> np.ndarray:
    """(H, W, 3) white."""
    return np.full((height, width, 3), 255, np.uint8)
