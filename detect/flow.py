"""Dense optical flow behind one call: `flow_method(name)(reference, image) -> w`.

The sign is the project's: image(p) = reference(p + w(p)), w in px, x right, y down.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np

from detect.differential import horn_schunck, lucas_kanade
from geometry.arrays import FloatMap, GreyImage
from geometry.errors import BadInputError

Flow: TypeAlias = Callable[[GreyImage, GreyImage], FloatMap]


@cache
def dis_matcher(*, refinements: int) -> Any:
    """DIS flow (Kroeger et al., ECCV 2016) down to the finest scale; takes a start flow."""
    matcher = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    matcher.setFinestScale(0)
    matcher.setPatchSize(8)
    matcher.setPatchStride(4)
    matcher.setGradientDescentIterations(8)
    matcher.setVariationalRefinementIterations(refinements)
    return matcher


def dis_flow(reference: GreyImage, image: GreyImage) -> FloatMap:
    """Dense inverse search (Kroeger et al., ECCV 2016)."""
    return np.asarray(dis_matcher(refinements=3).calc(image, reference, None))


def farneback_flow(reference: GreyImage, image: GreyImage) -> FloatMap:
    """Polynomial expansion (Farneback, SCIA 2003)."""
    start = np.zeros((*image.shape, 2), np.float32)
    pyramid, window, iterations, polynomial = (0.5, 4), 15, 5, (5, 1.1)
    flow = cv2.calcOpticalFlowFarneback(
        image, reference, start, *pyramid, window, iterations, *polynomial, 0
    )
    return np.asarray(flow)


def deep_flow(reference: GreyImage, image: GreyImage) -> FloatMap:
    """Variational flow of DeepFlow (Weinzaepfel et al., ICCV 2013), as OpenCV has it."""
    return np.asarray(cv2.optflow.createOptFlow_DeepFlow().calc(image, reference, None))


def pca_flow(reference: GreyImage, image: GreyImage) -> FloatMap:
    """A smooth basis fitted to sparse matches (Wulff & Black, CVPR 2015): coarse and fast."""
    return np.asarray(cv2.optflow.createOptFlow_PCAFlow().calc(image, reference, None))


METHODS: dict[str, Flow] = {
    "horn-schunck": horn_schunck,
    "lucas-kanade": lucas_kanade,
    "dis": dis_flow,
    "farneback": farneback_flow,
    "deepflow": deep_flow,
    "pcaflow": pca_flow,
}


def flow_method(name: str) -> Flow:
    """The flow method of that name, or the network in that .onnx file.

    Raises:
        BadInputError: No such method, or an .onnx file that cannot be used.
    """
    if name in METHODS:
        return METHODS[name]
    if name.endswith(".onnx"):
        from detect.onnx_flow import OnnxFlow

        return OnnxFlow(Path(name))
    raise BadInputError(
        f"flow method {name!r} is unknown; take one of {', '.join(METHODS)} or an .onnx file"
    )
