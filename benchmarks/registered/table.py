"""Both contenders on the test clips that `render` made, by strength and noise.

    OMP_NUM_THREADS=1 python -m benchmarks.registered table NETWORK.onnx FOLDER

Prints a table of scores, and the reliability of the evidence.
"""

import argparse
from pathlib import Path

from benchmarks.registered.bins import print_reliability
from benchmarks.registered.render import CONDITIONS, name_of
from benchmarks.registered.tally import ClipTally
from detect.learning.clips import TrainingClip, clip_seed, list_clips
from detect.registered.evidence_network import EvidenceNetwork


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("network", type=Path)
    parser.add_argument("folder", type=Path)


def main(options: argparse.Namespace) -> None:
    network = EvidenceNetwork(options.network)
    print("| amplitude, noise | contender | AUROC | AP | EPE / of zero, px | llr > 1 in plumes "
          "| outside |\n|" + "---|" * 7)  # fmt: skip
    tallies = {}
    for amplitude_px, noise in CONDITIONS:
        tally = ClipTally(network)
        for path in list_clips(options.folder / name_of(amplitude_px, noise)):
            tally.add(TrainingClip.load(path), clip_seed(path))
        tallies[f"{amplitude_px:.1f} px, {noise:.0f}/255"] = tally
        for row in tally.rows():
            print(f"| {amplitude_px:.1f} px, {noise:.0f}/255 | {row} |", flush=True)
    print_reliability(tallies)
