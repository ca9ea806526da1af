"""What the default mask holds on photos without a plume that nothing was trained on.

    python -m benchmarks.single_frame blobs --networks A.onnx --photos PHOTOS [--others FOLDERS]

Prints for each network and group of photos (the test split of PHOTOS, each folder in FOLDERS) how
many connected parts the masks have, and the mean share of pixels with evidence.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from benchmarks.single_frame.contenders import MASK_NATS
from benchmarks.single_frame.photos import detected, photo
from detect.dybs import DybsDetector
from detect.synthesis.raster import find_photos


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--networks", nargs="+", type=Path, required=True)
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--others", type=Path)


def main(options: argparse.Namespace) -> None:
    groups = {"photos of the test split": list(find_photos(options.photos, "test"))}
    for folder in sorted(options.others.iterdir()) if options.others else []:
        found = [p for p in sorted(folder.rglob("*")) if p.suffix.lower() in {".jpg", ".png"}]
        groups[folder.name] = found
    print("| network | photos | number | false blobs | per 100 | share of pixels with evidence |\n|"
          + "---|" * 6)  # fmt: skip
    for path in options.networks:
        detector, every, all_blobs = DybsDetector(path), 0, 0
        for name, photos in groups.items():
            llrs = [detected(detector, photo(p)).llr for p in photos]
            count = sum(
                cv2.connectedComponents((x > MASK_NATS).astype(np.uint8))[0] - 1 for x in llrs
            )
            every, all_blobs = every + len(photos), all_blobs + count
            share = np.mean([(llr != 0).mean() for llr in llrs])
            print(f"| {path.stem} | {name} | {len(photos)} | {count} | "
                  f"{100 * count / len(photos):.1f} | {share:.3f} |", flush=True)  # fmt: skip
        print(f"| {path.stem} | all | {every} | {all_blobs} | {100 * all_blobs / every:.1f} | |")
