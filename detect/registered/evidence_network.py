"""A network from a measurement to scores of refraction, and their calibration."""

from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from detect.calibration import Calibration
from detect.network import Network
from detect.registered.features import FEATURES, decode_feature
from detect.response import Response
from geometry.arrays import BoolArray, FloatMap
from geometry.errors import BadInputError

SurfaceClasses = NDArray[np.uint8]

SCORES = ("logit", "excess")
EXCESS_FROM = -2.0
"""Where the logit's slope may change: it is too steep below and not steep enough above."""
OUTPUTS = {"displacement": 2, "log_variance": 1, "logit": 1}
TEXTURES = (1.5, 8.0, 40.0)
"""Texture from which on a surface is bare, fair or rich, (grey levels per px) squared."""
EDGE_PX = 1.0
"""Depth edge from which on a pixel is one of an edge, px of parallax."""
LEAST_TEXTURE, LEAST_VISIBLE = 0.3, 1.0
"""Texture, and neighbours that see it, of a pixel that is measured."""
MOST_SIGMA_PX = 0.19
"""Median sigma of a frame above which there is no evidence; of 100 clips without trouble 99 lie
below.

Frames registered worse did not show a real leak, and still give too much evidence for plumes.
"""


class SurfaceClass(IntEnum):
    """What surface a pixel shows; on each the network errs in its own way."""

    EMPTY = 0
    BARE = 1
    FAIR = 2
    RICH = 3
    EDGE = 4


CLASS_NAMES = tuple(surface.name.lower() for surface in SurfaceClass)


@dataclass(frozen=True, kw_only=True)
class NetworkOutput:
    """What the network estimates at (H, W) pixels, before calibration.

    Attributes:
        displacement: (H, W, 2) px.
        sigma_px: (H, W) of either component.
        scores: (H, W, 2), `SCORES`: the logit, and by how much it exceeds `EXCESS_FROM`, softly.
        surfaces: (H, W) of `SurfaceClass`.
        measured: (H, W) false where the features hold nothing, and all over a frame that is
            registered too badly.
    """

    displacement: FloatMap
    sigma_px: FloatMap
    scores: FloatMap
    surfaces: SurfaceClasses
    measured: BoolArray

    def llr(self, calibration: Calibration) -> FloatMap:
        """(H, W) evidence in nats; 0 where there is none."""
        llr = calibration.llr(self.scores, self.surfaces, CLASS_NAMES)
        return np.where(self.measured, llr, np.float32(0))


class EvidenceNetwork:
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

    def read_calibration(self) -> Calibration:
        """The calibration of the scores, as stored in the file.

        Raises:
            BadInputError: There is none, or it is of other scores.
        """
        where = str(self.network.path)
        calibration = Calibration.from_plain(self.network.read_metadata("calibration"), where)
        if calibration.scores != SCORES:
            raise BadInputError(f"{where}: calibrated for other scores; calibrate it anew")
        return calibration

    def read_response(self) -> Response | None:
        """How much evidence a displacement gets, as stored in the file; None where it is not.

        Raises:
            BadInputError: It is something else.
        """
        content = self.network.read_metadata("response")
        return None if content is None else Response.from_plain(content, str(self.network.path))

    def evaluate(self, inputs: FloatMap) -> NetworkOutput:
        """Evaluates (C, H, W) features; the network runs only where anything was measured."""
        texture = decode_feature(inputs, "log_texture")
        surfaces = classify_surfaces(texture, decode_feature(inputs, "log_depth_edge"))
        measured = _find_measured(inputs, texture)
        if not measured.any():
            return _no_output(surfaces)
        maps = self.network(inputs)
        logit = maps["logit"][0]
        return NetworkOutput(
            displacement=np.ascontiguousarray(maps["displacement"].transpose(1, 2, 0)),
            sigma_px=np.exp(maps["log_variance"][0] / 2),
            scores=np.stack([logit, np.logaddexp(0, logit - EXCESS_FROM)], axis=-1),
            surfaces=surfaces,
            measured=measured,
        )


def _find_measured(inputs: FloatMap, texture: FloatMap) -> BoolArray:
    """(H, W) where features hold something; nowhere in a frame that is registered too badly."""
    seen = (texture >= LEAST_TEXTURE) & (decode_feature(inputs, "visible") >= LEAST_VISIBLE)
    well = seen & (decode_feature(inputs, "log_sigma") <= MOST_SIGMA_PX)
    return seen & (2 * np.count_nonzero(well) >= np.count_nonzero(seen))


def _no_output(surfaces: SurfaceClasses) -> NetworkOutput:
    nothing = np.zeros((*surfaces.shape, 2), np.float32)
    return NetworkOutput(
        displacement=nothing,
        sigma_px=np.full(surfaces.shape, np.inf, np.float32),
        scores=nothing,
        surfaces=surfaces,
        measured=np.zeros(surfaces.shape, np.bool_),
    )


def classify_surfaces(texture: FloatMap, depth_edge_px: FloatMap) -> SurfaceClasses:
    """(H, W) of `SurfaceClass`, by the gradients and the depth edges there."""
    surfaces = np.zeros(texture.shape, np.uint8)
    for limit in TEXTURES:
        surfaces += texture >= limit
    return np.where(depth_edge_px > EDGE_PX, np.uint8(SurfaceClass.EDGE), surfaces)
