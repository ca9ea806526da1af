"""Displacement and evidence as pictures: colours in OpenCV's order, blue, green, red."""

import cv2
import numpy as np
from numpy.typing import NDArray

from geometry.arrays import FloatArray, FloatMap, GreyImage, Picture

FULL_ALPHA = 0.8
"""Opacity of the evidence at full scale."""
TEXT_HEIGHT = 0.05
"""Of the number in the corner, in heights of the picture."""
LEAST_TEXT_PX = 9
HERSHEY_PX = 22
"""Height of a digit of OpenCV's plain font at scale 1."""


def displacement_picture(displacement: FloatMap, full_scale_px: float | None = None) -> Picture:
    """The colours of a displacement, with its largest norm in px in the corner.

    Args:
        displacement: (H, W, 2) px, x right, y down; what is not finite counts as none.
        full_scale_px: The size of full saturation; the largest norm if left out.

    Returns:
        (H, W, 3).
    """
    known = np.where(np.isfinite(displacement), displacement, 0)
    largest_px = float(np.linalg.norm(known, axis=-1).max())
    picture = displacement_colours(known, full_scale_px or largest_px)
    return add_label(picture, f"{largest_px:.2f} px")


def displacement_colours(displacement: FloatMap, full_scale_px: float) -> Picture:
    """(H, W, 3) hue for the direction of (H, W, 2), saturation for the size.

    White is no displacement. What shows background from its right is red, from below
    yellow-green, from its left cyan, from above violet. Source: the DYBS paper, figures 6 to 9.
    """
    x, y = np.moveaxis(displacement, -1, 0)
    size = np.hypot(x, y).astype(np.float32)
    hue = np.degrees(np.arctan2(y, x)).astype(np.float32) % 360
    hsv = np.stack([hue, np.minimum(size / max(full_scale_px, 1e-9), 1), np.ones_like(hue)], -1)
    bgr = cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)
    return np.asarray(np.rint(255 * bgr), dtype=np.uint8)


def overlay_evidence(image: GreyImage | Picture, llr: FloatMap, full_scale_nats: float) -> Picture:
    """(H, W, 3) a frame, grey or in colour, with the positive evidence laid over it."""
    layer = evidence_layer(llr, full_scale_nats).astype(np.float32)
    alpha = layer[..., 3:] / 255
    below = image[..., None] if image.ndim == 2 else image
    return np.rint(below * (1 - alpha) + layer[..., :3] * alpha).astype(np.uint8)


def evidence_layer(llr: FloatMap, full_scale_nats: float) -> Picture:
    """(H, W, 4) the positive evidence: transparent at 0 nats, hot at `full_scale_nats`."""
    strength = np.clip(llr / full_scale_nats, 0.0, 1.0).astype(np.float32)
    layer = np.dstack([heat_colours(strength), np.zeros_like(strength, dtype=np.uint8)])
    layer[..., 3] = (255 * FULL_ALPHA * np.minimum(1.0, 1.6 * strength)).astype(np.uint8)
    return layer


def heat_colours(strength: FloatMap) -> Picture:
    """(H, W, 3) of (H, W) values in 0 to 1; the dark end of the map is left out."""
    if not strength.size:  # OpenCV divides by the size, and ends the process
        return np.zeros((*strength.shape, 3), np.uint8)
    level = (80 + 170 * strength).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(level, cv2.COLORMAP_INFERNO), dtype=np.uint8)


def heat_rgb(strength: FloatArray) -> NDArray[np.uint8]:
    """(N, 3) red, green, blue of (N,) values, shown from 0 to 1."""
    return heat_colours(np.clip(strength, 0, 1).astype(np.float32)[None])[0, :, ::-1]


def add_label(picture: Picture, text: str) -> Picture:
    """Writes a text into the upper left corner of (H, W, 3), in place; returns it."""
    height_px = max(LEAST_TEXT_PX, round(TEXT_HEIGHT * picture.shape[0]))
    scale, stroke = height_px / HERSHEY_PX, max(1, round(height_px / HERSHEY_PX))
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, stroke)
    left, base = height_px // 2, height_px // 2 + height
    corner = (left + width + height_px // 2, base + below + height_px // 4)
    cv2.rectangle(picture, (0, 0), corner, (255, 255, 255), -1)
    cv2.putText(
        picture, text, (left, base), cv2.FONT_HERSHEY_SIMPLEX, scale, (0, 0, 0), stroke, cv2.LINE_AA
    )
    return picture
