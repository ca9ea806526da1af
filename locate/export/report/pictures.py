"""Frames with the evidence laid over them, as data URIs."""

from base64 import b64encode
from collections.abc import Sequence

import cv2
import numpy as np

from geometry.arrays import FloatMap, Picture
from locate.export.pictures import displacement_colours, evidence_layer, heat_rgb

MAX_WIDTH, MAX_LAYER_WIDTH = 1024, 512
"""Of a frame and of what is laid over or beside it, px; they bound the size of the file."""
FRAME_QUALITY, LAYER_QUALITY = 72, 70
"""Of JPEG and WebP, out of 100; chosen by hand."""


def frame_uri(picture: Picture) -> str:
    """A JPEG of a frame."""
    height, width = picture.shape[:2]
    size = _fitted_size(width, height, MAX_WIDTH)
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return _jpeg_uri(np.asarray(small, dtype=np.uint8), FRAME_QUALITY)


def evidence_uri(llr: FloatMap, full_scale_nats: float) -> str:
    """A WebP of the positive evidence: transparent at 0 nats, hot at `full_scale_nats`."""
    height, width = llr.shape
    size = _fitted_size(width, height, MAX_LAYER_WIDTH)
    resized = cv2.resize(np.asarray(llr, dtype=np.float32), size, interpolation=cv2.INTER_AREA)
    return _webp_uri(evidence_layer(np.asarray(resized), full_scale_nats), LAYER_QUALITY)


def displacement_uri(displacement: FloatMap, full_scale_px: float) -> str:
    """A JPEG of a displacement: hue for the direction, full colour at `full_scale_px`."""
    height, width = displacement.shape[:2]
    size = _fitted_size(width, height, MAX_LAYER_WIDTH)
    resized = cv2.resize(displacement, size, interpolation=cv2.INTER_AREA)
    return _jpeg_uri(displacement_colours(np.asarray(resized), full_scale_px), LAYER_QUALITY)


def _fitted_size(width: int, height: int, most: int) -> tuple[int, int]:
    """(width, height) of the same shape, no wider than `most`."""
    shown = min(width, most)
    return shown, max(1, round(height * shown / width))


def heat_stops(count: int = 8) -> list[str]:
    """Colours from no evidence to full scale, ``#rrggbb``."""
    return [f"#{bytes(colour).hex()}" for colour in heat_rgb(np.linspace(0, 1, count))]


def full_scale_nats(maps: Sequence[FloatMap]) -> float:
    """A round upper end for the colour scale of all frames together."""
    if not maps:
        return 1.0
    top = max(float(np.percentile(llr, 99.8)) for llr in maps)
    return float(np.clip(np.ceil(2 * top) / 2, 1.0, 20.0))


def full_scale_px(maps: Sequence[FloatMap]) -> float:
    """The displacement of full colour in all frames: one that few pixels pass, rounded."""
    if not maps:
        return 1.0
    top = max(float(np.percentile(np.linalg.norm(one, axis=-1), 99.5)) for one in maps)
    return float(f"{max(top, 0.02):.1g}")


def _webp_uri(picture: Picture, quality: int) -> str:
    """Small, and may be transparent; it takes twenty times as long as a JPEG."""
    return _uri("webp", picture, [cv2.IMWRITE_WEBP_QUALITY, quality])


def _jpeg_uri(picture: Picture, quality: int) -> str:
    return _uri("jpeg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])


def _uri(kind: str, picture: Picture, options: Sequence[int]) -> str:
    done, encoded = cv2.imencode(f".{kind}", picture, options)
    if not done:
        raise RuntimeError(f"OpenCV could not encode a {kind} picture")
    return f"data:image/{kind};base64,{b64encode(encoded.tobytes()).decode()}"
