"""Real pairs of a reference and a plume: every flow method against the authors' PIV field.

    OMP_NUM_THREADS=1 python -m benchmarks.flow pairs [DATA_DIR] [--methods horn-schunck ...]
                                                     [--network DYBS.onnx ...]

The blowtorch pair comes with displacements from PIV: 137 x 336 windows of 16 px, one every 8 px.
They lead from the reference to the image, ours from the image to the reference: the opposite sign
along the same axes (u right, v down). Windows beyond 6 px are the PIV's own outliers. Both fields
stand without their medians; ours is averaged over a window (Gaussian, sigma 4 px).

Peak memory is the process's so far: name one method to get its own.

A network sees one frame alone; `bos` (Horn-Schunck) is its truth: plume above 0.3 px, none below
0.1 px. What it says on the reference, where no plume is, shows what it makes of the background.
"""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import scipy.io

from benchmarks.common.cost import peak_mib
from detect.bos import texture_of, unbiased_flow
from detect.bos_checks import FrameCheck
from detect.dybs import DybsDetector
from detect.dybs.estimator import SingleFrameEstimator
from detect.flow import METHODS, flow_method
from detect.scores import auroc
from geometry.arrays import FloatArray, FloatMap, GreyImage
from locate.recording.images import read_grey

DEFAULT_DATA = Path(__file__).parents[2] / "../shared/data"
BLOWTORCH = ("blowtorch_plume", "sop_enc_test_000.tif", "sop_enc_test_001.tif")
JET = ("supersonic_jet", "A000.tif", "A001.tif")
STEP_PX, FIRST_PX, WINDOW_SIGMA_PX, OUTLIER_PX = 8, 8, 4.0, 6.0
PLUME_PX, STILL_PX = 0.3, 0.1


def read_piv(folder: Path) -> tuple[FloatArray, FloatArray]:
    """u and v, px, in the authors' sign. A .mat of version 5 holds arrays: nothing is unpickled."""
    u, v = (
        scipy.io.loadmat(str(folder / f"{name}_PIV_sop_enc_test.mat"))[f"{name}_original"].item(0)
        for name in "uv"
    )
    return u, v


def piv_agreement(displacement: FloatMap, piv: FloatArray, axis: int) -> tuple[float, float, float]:
    """Correlation, median difference in px, and slope of one component."""
    rows, columns = (
        (FIRST_PX + STEP_PX * np.arange(n)).clip(max=side - 1)
        for n, side in zip(piv.shape, displacement.shape, strict=False)
    )
    ours = cv2.GaussianBlur(displacement[..., axis], (0, 0), WINDOW_SIGMA_PX)[np.ix_(rows, columns)]
    theirs = -(piv - np.nanmedian(piv))
    known = np.isfinite(theirs) & (np.abs(theirs) < OUTLIER_PX)
    ours, theirs = ours[known] - np.median(ours[known]), theirs[known]
    slope = (ours * theirs).sum() / (theirs**2).sum()
    difference_px = float(np.median(np.abs(ours - theirs)))
    return float(np.corrcoef(ours, theirs)[0, 1]), difference_px, float(slope)


def piv_row(displacement: FloatMap, piv: FloatArray, axis: int) -> str:
    r, difference_px, slope = piv_agreement(displacement, piv, axis)
    return f"{r:.3f} | {difference_px:.3f} | {slope:.2f}"


def compare_methods(data: Path, methods: Sequence[str]) -> None:
    print("| pair | flow | r u | median difference, px | slope | r v | median difference, px | "
          "slope | w, 99 %, px | fault | CPU s | peak MB |\n" + "|---" * 12 + "|")  # fmt: skip
    for name, first, second in (BLOWTORCH, JET):
        folder = data / "1_bos_pairs" / name
        reference, image = read_grey(folder / first), read_grey(folder / second)
        texture = texture_of(reference)
        for method in methods:
            start = time.process_time()
            w, bias_px = unbiased_flow(flow_method(method), reference, image, texture)
            seconds = time.process_time() - start
            agreement = "- | - | - | - | - | -"
            if name == BLOWTORCH[0]:
                agreement = " | ".join(piv_row(w, piv, k) for k, piv in enumerate(read_piv(folder)))
            large = np.percentile(np.linalg.norm(w, axis=-1), 99)
            fault = FrameCheck.compare(reference, image, w, bias_px, texture).fault
            print(f"| {name} | {method} | {agreement} | {large:.2f} | {fault and fault.name} | "
                  f"{seconds:.1f} | {peak_mib():.0f} |", flush=True)  # fmt: skip


def network_row(path: Path, image: GreyImage, truth: FloatMap | None) -> str:
    """What a single-frame network, its demodulator and its calibrated evidence make of an image."""
    estimator = SingleFrameEstimator(path)
    estimate = estimator.estimate(image)
    logit, size = estimate.scores[..., 0], np.linalg.norm(estimate.displacement, axis=-1)
    evidence = "-"
    if estimator.network.read_metadata("calibration") is not None:
        evidence = f"{(DybsDetector(path).to_detection(estimate).llr > 1).mean():.4f}"
    said = f"{size.mean():.3f} | {(logit > 0).mean():.3f} | {evidence}"
    if truth is None:
        return f"{said} | - | - | -"
    true_size = np.linalg.norm(truth, axis=-1)
    judged = (true_size > PLUME_PX) | (true_size < STILL_PX)
    area = auroc(logit[judged], true_size[judged] > PLUME_PX)
    r = [np.corrcoef(estimate.displacement[..., k].flat, truth[..., k].flat)[0, 1] for k in (0, 1)]
    error = np.linalg.norm(estimate.displacement - truth, axis=-1).mean()
    return f"{said} | {area:.3f} | {r[0]:.2f}, {r[1]:.2f} | {error:.3f} / {true_size.mean():.3f}"


def compare_networks(data: Path, paths: Sequence[Path]) -> None:
    print("\n| network | frame | mean size, px | logits above 0, share | evidence above 1 nat | "
          "AUROC | r u, r v | error / of zero, px |\n" + "|---" * 8 + "|")  # fmt: skip
    for name, first, second in (BLOWTORCH, JET):
        folder = data / "1_bos_pairs" / name
        reference, image = read_grey(folder / first), read_grey(folder / second)
        bos = flow_method("horn-schunck")
        truth, _ = unbiased_flow(bos, reference, image, texture_of(reference))
        for path in paths:
            print(f"| {path.name} | {name} | {network_row(path, image, truth)} |")
            print(f"| {path.name} | {name}, reference | {network_row(path, reference, None)} |")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("data", type=Path, nargs="?", default=DEFAULT_DATA)
    parser.add_argument("--methods", nargs="*", default=list(METHODS))
    parser.add_argument("--network", type=Path, nargs="*", default=[])


def main(options: argparse.Namespace) -> None:
    if options.methods:
        compare_methods(options.data, options.methods)
    if options.network:
        compare_networks(options.data, options.network)
