"""Frames with the evidence laid over them, as data URIs."""

from base64 import b64encode

import cv2
import numpy as np

from geometry.arrays import FloatMap, GreyImage
from locate.export.pictures import Picture, evidence_layer, heat_colours

MAX_WIDTH = 640
"""Of a picture on the page, px; bounds the size of the file."""


def fitted_size(image: GreyImage) -> tuple[int, int]:
    """(width, height) of a picture of `image` that is no wider than MAX_WIDTH."""
    height, width = image.shape
    shown = min(width, MAX_WIDTH)
    return shown, round(height * shown / width)


def frame_uri(image: GreyImage) -> str:
    """A small JPEG of a grey frame."""
    small = cv2.resize(image, fitted_size(image), interpolation=cv2.INTER_AREA)
    return _data_uri("jpeg", np.asarray(small, dtype=np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 80])


def evidence_uri(llr: FloatMap, size: tuple[int, int], full_scale_nats: float) -> str:
    """A WebP of the positive evidence: transparent at 0 nats, hot at `full_scale_nats`."""
    resized = cv2.resize(np.asarray(llr, dtype=np.float32), size, interpolation=cv2.INTER_AREA)
    layer = evidence_layer(np.asarray(resized), full_scale_nats)
    return _data_uri("webp", layer, [cv2.IMWRITE_WEBP_QUALITY, 70])


def heat_stops(count: int = 8) -> list[str]:
    """Colours from no evidence to full scale, ``#rrggbb``."""
    strength = np.linspace(0, 1, count, dtype=np.float32)[None]
    rows = heat_colours(strength)[0]
    return [f"#{red:02x}{green:02x}{blue:02x}" for blue, green, red in rows.tolist()]


def full_scale_nats(maps: list[FloatMap]) -> float:
    """A round upper end for the colour scale of all frames together."""
    if not maps:
        return 1.0
    top = max(float(np.percentile(llr, 99.8)) for llr in maps)
    return float(np.clip(np.ceil(2 * top) / 2, 1.0, 20.0))


def _data_uri(kind: str, picture: Picture, options: list[int]) -> str:
    done, encoded = cv2.imencode(f".{'jpg' if kind == 'jpeg' else kind}", picture, options)
    if not done:
        raise RuntimeError(f"OpenCV could not encode a {kind} picture")
    return f"data:image/{kind};base64,{b64encode(encoded.tobytes()).decode()}"
