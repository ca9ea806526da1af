"""Stand-ins for messages: the fields and nothing else."""

from types import SimpleNamespace
from typing import Any

import numpy as np


def header(stamp_ns: int = 0, frame_id: str = "camera") -> Any:
    stamp = SimpleNamespace(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return SimpleNamespace(stamp=stamp, frame_id=frame_id)


def image(samples: np.ndarray, encoding: str, *, padding: int = 0, big: bool = False) -> Any:
    """The message that carries these samples, with `padding` junk bytes behind each row."""
    height, width = samples.shape[:2]
    order = ">" if big else "<"
    rows = samples.astype(samples.dtype.newbyteorder(order)).reshape(height, -1).view(np.uint8)
    junk = np.full((height, padding), 0xA5, np.uint8)
    data = np.concatenate([rows, junk], axis=1)
    return SimpleNamespace(
        header=header(),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=int(big),
        step=data.shape[1],
        data=data.tobytes(),
    )


def camera_info(**changes: Any) -> Any:
    fields = {
        "header": header(),
        "width": 640,
        "height": 480,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [500.0, 0, 320, 0, 510, 240, 0, 0, 1],
        "p": [480.0, 0, 310, 0, 0, 480, 230, 0, 0, 0, 1, 0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0),
    }
    return SimpleNamespace(**{**fields, **changes})


def vector(x: float, y: float, z: float) -> Any:
    return SimpleNamespace(x=x, y=y, z=z)


def quaternion(x: float, y: float, z: float, w: float) -> Any:
    return SimpleNamespace(x=x, y=y, z=z, w=w)
