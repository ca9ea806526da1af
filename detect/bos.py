"""Background-oriented schlieren: flow against a known reference view."""

from collections.abc import Sequence

import numpy as np

from detect.detection import Detection, Frames
from detect.evidence import displacement_evidence
from detect.flow import Flow, flow_method
from detect.response import Response
from detect.warp import blur, gradients, pixel_grid, sample, structure_tensor
from geometry.arrays import FloatArray, FloatMap, GreyImage
from geometry.errors import BadInputError

WINDOW_PX = 4.0
"""Standard deviation of the window of texture and of what the flow leaves, px; chosen by hand."""
GREY_NOISE_FLOOR = 0.5
"""Least noise of an image, grey levels."""
METHOD_FLOOR_PX = 0.01
"""Least sigma of a displacement."""
LARGEST_SCALE = 3.0
"""By which the scatter of a frame may widen sigma; chosen by hand."""


class BosDetector:
    """Refraction by optical flow against a reference without plume.

    The reference is an image given, or the temporal median of a still camera; against that only
    what changes in a plume shows, its mean is part of the reference. Small shifts of
    the whole image (vibration) are taken out by the median flow of each direction, as the plume
    covers the smaller part of it. Source: the DYBS paper, section II.

    Args:
        flow: Name of a flow method (`detect.flow.METHODS`) or path of an .onnx flow network.
        reference: (H, W) uint8, the view without plume; None takes the temporal median.
        reference_frames: At most so many frames, spread evenly, enter the temporal median.
    """

    name = "bos"
    response: Response | None = None

    def __init__(
        self,
        *,
        flow: str = "horn-schunck",
        reference: GreyImage | None = None,
        reference_frames: int = 31,
    ) -> None:
        self._flow = flow_method(flow)
        self._given = reference
        self._reference_frames = reference_frames
        self._median: tuple[Sequence[GreyImage], GreyImage] | None = None

    @property
    def uses_other_frames(self) -> bool:
        """Whether the reference is taken from the frames."""
        return self._given is None

    def detect(self, frames: Frames, index: int) -> Detection:
        """Measures frame `index` against the reference.

        Raises:
            BadInputError: The reference differs in size, or there is none and fewer than three
                frames to take it from.
        """
        image, reference = frames.images[index], self._find_reference(frames)
        if image.shape != reference.shape:
            raise BadInputError(
                f"frame {index} is {image.shape}, the reference {reference.shape}: "
                "they must be of one size"
            )
        texture = texture_of(reference)
        displacement, _ = unbiased_flow(self._flow, reference, image, texture)
        sigma_px = flow_sigma(reference, image, displacement)
        llr, sigma_px = displacement_evidence(
            displacement, sigma_px, texture, np.ones_like(texture), largest_scale=LARGEST_SCALE
        )
        return Detection(displacement=displacement, sigma_px=sigma_px, llr=llr)

    def _find_reference(self, frames: Frames) -> GreyImage:
        if self._given is not None:
            return self._given
        if self._median is None or self._median[0] is not frames.images:
            self._median = (frames.images, temporal_median(frames.images, self._reference_frames))
        return self._median[1]


def temporal_median(images: Sequence[GreyImage], most: int) -> GreyImage:
    """(H, W) uint8 median over at most `most` evenly spread frames.

    Raises:
        BadInputError: Fewer than three frames.
    """
    if len(images) < 3:
        raise BadInputError(
            f"a temporal reference takes at least 3 frames, got {len(images)}; "
            "give a reference image"
        )
    rows = np.unique(np.linspace(0, len(images) - 1, min(most, len(images))).round().astype(int))
    median = np.median([images[row] for row in rows], axis=0)
    return np.asarray(median.round(), dtype=np.uint8)


def mean_reference(images: Sequence[GreyImage]) -> GreyImage:
    """(H, W) uint8 mean of frames without plume; the noise of N of them falls by sqrt(N)."""
    return np.asarray(np.mean(images, axis=0, dtype=np.float32).round(), dtype=np.uint8)


def texture_of(reference: GreyImage) -> FloatMap:
    """(H, W) mean squared gradient round every pixel, (grey levels per px) squared."""
    gx, gy = gradients(blur(reference.astype(np.float32), 0.7))
    return blur(gx * gx + gy * gy, WINDOW_PX)


def unbiased_flow(
    flow: Flow, reference: GreyImage, image: GreyImage, texture: FloatMap
) -> tuple[FloatMap, FloatArray]:
    """(H, W, 2) flow without its median in each direction, px, and (2,) that median."""
    displacement = flow(reference, image)
    bias_px = median_bias(displacement, texture)
    return np.asarray(displacement - bias_px, dtype=np.float32), bias_px.astype(float)


def median_bias(displacement: FloatMap, texture: FloatMap) -> FloatMap:
    """(2,) px, the median flow of each direction over the better textured half of the image."""
    textured = texture >= np.median(texture)
    return np.asarray(np.median(displacement[textured], axis=0))


def flow_sigma(reference: GreyImage, image: GreyImage, displacement: FloatMap) -> FloatMap:
    """(H, W) px, standard deviation of a flow component in a window; inf without texture.

    Source: least squares in a window, sigma^2 = noise^2 trace(M^-1) / 2 with M the sum of the
    gradients' outer products; the noise is what the flow leaves unexplained round the pixel.
    """
    registered = sample(reference, pixel_grid(image.shape) + displacement)
    leftover = blur((image - registered) ** 2, WINDOW_PX) + GREY_NOISE_FLOOR**2
    gx, gy = gradients((registered + image) / 2)
    xx, xy, yy = structure_tensor(gx, gy, WINDOW_PX)
    pixels_in_window = 4 * np.pi * WINDOW_PX**2
    determinant = xx * yy - xy * xy
    variance = np.full_like(leftover, np.inf)
    np.divide(
        leftover * (xx + yy),
        2 * pixels_in_window * determinant,
        out=variance,
        where=determinant > 0,
    )
    return np.sqrt(variance + METHOD_FLOOR_PX**2).astype(np.float32)
