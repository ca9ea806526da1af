"""Optical flow by a network in an ONNX file."""

from pathlib import Path

import cv2
import numpy as np

from detect.network import open_session
from geometry.arrays import FloatMap, GreyImage
from geometry.errors import BadInputError

STRIDE_PX = 8


class OnnxFlow:
    """A flow network.

    The file's contract: one float32 input (1, 2C, H, W) or two (1, C, H, W), C = 1 or 3, grey
    levels 0 to 255, the image before the reference; first output (1, 2, H, W), the flow in px
    from the image to the reference. A network of free size gets images padded to multiples of
    8 px; one of fixed size gets them resized, and its flow is scaled back.

    Raises:
        BadInputError: The file is missing, is not ONNX, or breaks the contract.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._session = open_session(path, "flow network")
        self._inputs = self._session.get_inputs()
        shapes = [tuple(node.shape) for node in self._inputs]
        channels = {(1, 2): 1, (1, 6): 3, (2, 1): 1, (2, 3): 3}
        key = (len(shapes), shapes[0][1] if shapes and len(shapes[0]) == 4 else None)
        if key not in channels:
            raise BadInputError(
                f"{path}: inputs {shapes}, expected one (1, 2 or 6, H, W) or two (1, 1 or 3, H, W)"
            )
        self._channels = channels[key]
        height, width = shapes[0][2:]
        fixed = isinstance(height, int) and isinstance(width, int)
        self._size = (width, height) if fixed else None

    def __call__(self, reference: GreyImage, image: GreyImage) -> FloatMap:
        """(H, W, 2) w, px: image(p) = reference(p + w(p)).

        Raises:
            BadInputError: The network's output is not a flow of the input's size.
        """
        planes = [self._prepare_planes(image), self._prepare_planes(reference)]
        arrays = planes if len(self._inputs) == 2 else [np.concatenate(planes, axis=1)]
        feeds = {node.name: array for node, array in zip(self._inputs, arrays, strict=True)}
        try:
            flow = np.asarray(self._session.run(None, feeds)[0])
        except Exception as error:  # onnxruntime's errors share no base of their own
            raise BadInputError(f"{self.path}: the network failed on {image.shape=}") from error
        expected = (1, 2, *planes[0].shape[2:])
        if flow.shape != expected:
            raise BadInputError(f"{self.path}: output {flow.shape}, expected {expected}")
        return self._restore_flow(flow[0].transpose(1, 2, 0).astype(np.float32), image.shape)

    def _prepare_planes(self, image: GreyImage) -> FloatMap:
        if self._size:
            image = cv2.resize(image, self._size, interpolation=cv2.INTER_AREA)
        else:
            bottom, right = (-side % STRIDE_PX for side in image.shape)
            image = cv2.copyMakeBorder(image, 0, bottom, 0, right, cv2.BORDER_REPLICATE)
        return np.repeat(image[None, None].astype(np.float32), self._channels, axis=1)

    def _restore_flow(self, flow: FloatMap, shape: tuple[int, ...]) -> FloatMap:
        if not self._size:
            return flow[: shape[0], : shape[1]]
        scale = np.array([shape[1] / self._size[0], shape[0] / self._size[1]], np.float32)
        return np.asarray(cv2.resize(flow, (shape[1], shape[0])) * scale)
