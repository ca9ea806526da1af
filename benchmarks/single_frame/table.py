"""Every contender on samples of each background.

    OMP_NUM_THREADS=1 python -m benchmarks.single_frame table --networks A.onnx A-int8.onnx \\
        --test SAMPLES --validation SAMPLES [--plot auroc_by_peak.png] [--every 1]

Prints a row for each background and contender, and AUROC by peak; `--plot` draws that.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common.plots import text
from benchmarks.single_frame.contenders import Contenders
from benchmarks.single_frame.tally import PEAKS_PX, SampleTally
from detect.learning.dybs_calibration import labels_of
from detect.network import Network
from detect.synthesis import FAMILIES, Sample, shards_in
from geometry.arrays import FloatMap
from geometry.image_files import write_image

LATTICES = ("sinusoid", "checkerboard")


def null_map(folder: Path) -> FloatMap:
    """Share of positives by place, smooth."""
    positive = sum(labels_of(sample)[0].astype(np.float32) for sample in samples_in(folder, 1))
    return np.asarray(cv2.GaussianBlur(np.asarray(positive), (0, 0), 8))


def samples_in(folder: Path, every: int) -> Iterator[Sample]:
    for shard in shards_in(folder):
        yield from (shard.sample_at(i) for i in range(0, len(shard), every))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--networks", nargs="+", type=Path, required=True)
    parser.add_argument("--test", type=Path, required=True)
    parser.add_argument("--validation", type=Path, required=True)
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--every", type=int, default=1)


def main(options: argparse.Namespace) -> None:
    contenders = Contenders(options.networks, null_map(options.validation))
    tallies: defaultdict[tuple[str, str], SampleTally] = defaultdict(SampleTally)
    for sample in samples_in(options.test, options.every):
        for name, answer in contenders.answers(sample.image):
            tallies[sample.family, name].add(sample, answer)
    print("| background | contender | AUROC | AP | EPE / of zero, px | magnitude error at mean, px "
          "| r | ECE | precision | recall | with evidence |\n|" + "---|" * 11)  # fmt: skip
    for family in FAMILIES:
        for (of, name), tally in tallies.items():
            if of == family and (name != "waves alone" or family in LATTICES):
                print(f"| {family} | {name} | {tally.row(moves=name != 'null')} |", flush=True)
    if options.plot:
        first = Network(options.networks[0]).name
        names = ("null", "waves alone", "refinement alone", f"{first} alone", f"dybs, {first}")
        curves: dict[str, dict[str, list[float]]] = {}
        for family in ("sinusoid", "checkerboard", "lines", "scene"):
            shown = [name for name in names if family in LATTICES or name != "waves alone"]
            curves[family] = {name: tallies[family, name].by_peak() for name in shown}
            for name, values in curves[family].items():
                print(f"AUROC by peak, {family}, {name}: {' '.join(f'{v:.3f}' for v in values)}")
        write_image(options.plot, plot(curves))


def plot(curves: dict[str, dict[str, list[float]]]) -> np.ndarray:
    """One panel a family: AUROC against the peak of the plume, on a logarithmic axis."""
    colours = [(150, 150, 150), (60, 160, 60), (160, 60, 160), (200, 120, 30), (30, 60, 200)]
    middles = np.sqrt(np.multiply(PEAKS_PX[:-1], PEAKS_PX[1:]))
    columns = 60 + (np.log(middles) - np.log(0.08)) / np.log(1.1 / 0.08) * 300
    panels = []
    for family, lines in curves.items():
        panel = np.full((364, 400, 3), 255, np.uint8)
        for value in (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0):
            row = round(260 - (value - 0.4) / 0.6 * 220)
            cv2.line(panel, (60, row), (360, row), (225, 225, 225), 1)
            text(panel, f"{value:.1f}", (30, row + 4))
        for column, peak in zip(columns, middles, strict=True):
            text(panel, f"{peak:.2f}", (round(column) - 14, 276))
        text(panel, f"{family}: AUROC by peak, px", (60, 24))
        for k, (name, values) in enumerate(lines.items()):
            colour = colours[k if len(lines) == len(colours) or k == 0 else k + 1]
            rows = 260 - (np.clip(values, 0.4, 1) - 0.4) / 0.6 * 220
            known = np.isfinite(rows)
            points = np.stack([columns, rows], axis=-1)[known].round().astype(np.int32)
            cv2.polylines(panel, [points], False, colour, 2, cv2.LINE_AA)
            text(panel, name, (60, 296 + 14 * k), colour)
        panels.append(panel)
    return np.hstack(panels)
