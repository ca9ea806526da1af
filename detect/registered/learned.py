"""What a network makes of a measurement, and how much of it is believed."""

from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from detect.calibration import Calibration
from detect.network import Network
from detect.registered.features import FEATURES, feature
from detect.response import Response
from geometry.arrays import BoolArray, FloatMap
from geometry.errors import BadInputError

Places = NDArray[np.uint8]

SCORES = ("logit", "excess")
EXCESS_FROM = -2.0
"""Where the logit's slope may change: it is too steep below and not steep enough above."""
OUTPUTS = {"displacement": 2, "log_variance": 1, "logit": 1}
TEXTURES = (1.5, 8.0, 40.0)
EDGE_PX = 1.0
LEAST_TEXTURE, LEAST_SEEN = 0.3, 1.0
MOST_SIGMA_PX = 0.19
"""Median sigma of a frame above which nothing is said: 99 in 100 frames of calm clips lie below.

What is registered worse could not show a real leak, and is still taken too much for plumes.
"""


class Place(IntEnum):
    """What stands at a pixel; on each a network errs in its own way."""

    EMPTY = 0
    BARE = 1
    FAIR = 2
    RICH = 3
    EDGE = 4


CLASS_NAMES = tuple(place.name.lower() for place in Place)


@dataclass(frozen=True, kw_only=True)
class Opinion:
    """What a network says of (H, W) pixels, before anything is believed.

    Attributes:
        displacement: (H, W, 2) px.
        sigma_px: (H, W) of either component.
        scores: (H, W, 2), `SCORES`: the logit, and by how much it exceeds `EXCESS_FROM`, softly.
        places: (H, W) of `Place`.
        measured: (H, W) false where the features hold nothing, and all over a frame that is
            registered too badly.
    """

    displacement: FloatMap
    sigma_px: FloatMap
    scores: FloatMap
    places: Places
    measured: BoolArray

    def llr(self, calibration: Calibration) -> FloatMap:
        """(H, W) evidence in nats; 0 where nothing can be said."""
        llr = calibration.llr(self.scores, self.places, CLASS_NAMES)
        return np.where(self.measured, llr, np.float32(0))


class Reader:
    """A network over the channels of `detect.registered.features`.

    Args:
        weights: The .onnx file.

    Raises:
        BadInputError: The file is not such a network.
    """

    def __init__(self, weights: Path) -> None:
        self.network = Network(weights)
        missing = OUTPUTS.keys() - set(self.network.outputs)
        if missing or self.network.channels != len(FEATURES):
            raise BadInputError(
                f"{weights}: not a network over registered neighbours; it takes {len(FEATURES)} "
                f"channels and gives {', '.join(OUTPUTS)}"
            )

    def calibration(self) -> Calibration:
        """What the file says that its scores are worth.

        Raises:
            BadInputError: Nothing, or something about other scores.
        """
        where = str(self.network.path)
        calibration = Calibration.from_plain(self.network.json("calibration"), where)
        if calibration.scores != SCORES:
            raise BadInputError(f"{where}: calibrated for other scores; calibrate it anew")
        return calibration

    def response(self) -> Response | None:
        """What evidence the file says that a displacement gets; None where it does not say.

        Raises:
            BadInputError: It says something else.
        """
        content = self.network.json("response")
        return None if content is None else Response.from_plain(content, str(self.network.path))

    def read(self, inputs: FloatMap) -> Opinion:
        """Looks at (C, H, W) features; the network is only asked where anything was measured."""
        texture = feature(inputs, "log_texture")
        places = places_of(texture, feature(inputs, "log_depth_edge"))
        measured = _measured(inputs, texture)
        if not measured.any():
            return _no_opinion(places)
        maps = self.network(inputs)
        logit = maps["logit"][0]
        return Opinion(
            displacement=np.ascontiguousarray(maps["displacement"].transpose(1, 2, 0)),
            sigma_px=np.exp(maps["log_variance"][0] / 2),
            scores=np.stack([logit, np.logaddexp(0, logit - EXCESS_FROM)], axis=-1),
            places=places,
            measured=measured,
        )


def _measured(inputs: FloatMap, texture: FloatMap) -> BoolArray:
    """(H, W) where features hold something; nowhere in a frame that is registered too badly."""
    seen = (texture >= LEAST_TEXTURE) & (feature(inputs, "visible") >= LEAST_SEEN)
    well = seen & (feature(inputs, "log_sigma") <= MOST_SIGMA_PX)
    return seen & (2 * np.count_nonzero(well) >= np.count_nonzero(seen))


def _no_opinion(places: Places) -> Opinion:
    nothing = np.zeros((*places.shape, 2), np.float32)
    return Opinion(
        displacement=nothing,
        sigma_px=np.full(places.shape, np.inf, np.float32),
        scores=nothing,
        places=places,
        measured=np.zeros(places.shape, np.bool_),
    )


def places_of(texture: FloatMap, depth_edge_px: FloatMap) -> Places:
    """(H, W) of `Place`, by the gradients and the depth edges there."""
    places = np.zeros(texture.shape, np.uint8)
    for limit in TEXTURES:
        places += texture >= limit
    return np.where(depth_edge_px > EDGE_PX, np.uint8(Place.EDGE), places)
