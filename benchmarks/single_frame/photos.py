"""Photos as a detector gets them."""

from pathlib import Path

import cv2
import numpy as np

from detect.detection import Detection, Frames
from detect.dybs import DybsDetector
from geometry.arrays import GreyImage
from geometry.image_files import read_image

LONGEST_SIDE_PX = 1024


def detected(detector: DybsDetector, image: GreyImage) -> Detection:
    return detector.detect(Frames(images=[image]), 0)


def photo(path: Path) -> GreyImage:
    image = read_image(path)
    scale = LONGEST_SIDE_PX / max(image.shape)
    if scale < 1:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(image, dtype=np.uint8)
