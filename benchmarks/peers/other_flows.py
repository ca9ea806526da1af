"""Flow methods of other libraries, called as `detect.flow` calls its own."""

import contextlib
import io
from collections.abc import Mapping
from importlib.util import find_spec

import cv2
import numpy as np

from detect.flow import METHODS, Flow
from geometry.arrays import FloatMap, GreyImage


def tv_l1(reference: GreyImage, image: GreyImage) -> FloatMap:
    """scikit-image's TV-L1 (Zach, Pock & Bischof 2007), its defaults."""
    from skimage.registration import optical_flow_tvl1

    v, u = optical_flow_tvl1(image, reference)
    return np.stack([u, v], axis=-1)


def iterative_lucas_kanade(reference: GreyImage, image: GreyImage) -> FloatMap:
    """scikit-image's iterative Lucas-Kanade (Le Besnerais & Champagnat 2005), its defaults."""
    from skimage.registration import optical_flow_ilk

    v, u = optical_flow_ilk(image, reference)
    return np.stack([u, v], axis=-1)


def cross_correlation(reference: GreyImage, image: GreyImage) -> FloatMap:
    """OpenPIV's multi-pass correlation, its defaults: windows of 64, 32 and 16 px, half overlap.

    The vectors, 8 px apart, are brought to every pixel by cubic interpolation. Where OpenPIV's own
    validation rejects all of them, nothing was displaced.
    """
    from openpiv import windef

    try:
        with contextlib.redirect_stdout(io.StringIO()):
            x, y, u, v, _ = windef.simple_multipass(image, reference, windef.PIVSettings())
    except ValueError:
        return np.zeros((*image.shape, 2), np.float32)
    step = x[0, 1] - x[0, 0]
    rows = (np.arange(image.shape[0], dtype=np.float32) - y.min()) / step
    columns = (np.arange(image.shape[1], dtype=np.float32) - x.min()) / step
    x, y = np.meshgrid(columns.astype(np.float32), rows.astype(np.float32))
    vectors = np.stack([u, -v], axis=-1).astype(np.float32)  # OpenPIV's v points up
    return np.asarray(cv2.remap(vectors, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))


OTHERS: Mapping[str, tuple[str, Flow]] = {
    "scikit-image TV-L1": ("skimage", tv_l1),
    "scikit-image ILK": ("skimage", iterative_lucas_kanade),
    "OpenPIV": ("openpiv", cross_correlation),
}
"""By name: the package, and the method."""
TITLES = {
    "horn-schunck": "ours: Horn-Schunck",
    "lucas-kanade": "ours: Lucas-Kanade",
    "dis": "OpenCV DIS",
    "farneback": "OpenCV Farneback",
    "deepflow": "OpenCV DeepFlow",
    "pcaflow": "OpenCV PCAFlow",
}


def installed_flows() -> dict[str, Flow]:
    """Ours first, then every peer that is there."""
    flows = {title: METHODS[name] for name, title in TITLES.items()}
    for name, (package, flow) in OTHERS.items():
        if find_spec(package) is None:
            print(f"{name} is left out: {package} is not installed")
        else:
            flows[name] = flow
    return flows
