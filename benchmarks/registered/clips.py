"""Both contenders on training clips, by strength.

    OMP_NUM_THREADS=1 python -m benchmarks.registered clips NETWORK.onnx CLIPS... [--seeds A B]...

Prints a table of scores, and the reliability of the evidence. CLIPS are folders; with `--seeds`
only the clips of these ranges (first, after last) count.
"""

import argparse
from collections import defaultdict
from pathlib import Path

from benchmarks.registered.bins import print_reliability
from benchmarks.registered.tally import ClipTally
from detect.learning.clips import KINDS, TrainingClip, clip_seed
from detect.learning.registered_calibration import chosen
from detect.registered.evidence_network import EvidenceNetwork


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("network", type=Path)
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("--seeds", type=int, nargs=2, action="append", default=[])


def main(options: argparse.Namespace) -> None:
    network = EvidenceNetwork(options.network)
    tallies: defaultdict[str, ClipTally] = defaultdict(lambda: ClipTally(network))
    for path in chosen(options.clips, options.seeds):
        clip = TrainingClip.load(path)
        tallies[KINDS[clip.kind]].add(clip, clip_seed(path))
    print("| strength | contender | AUROC | AP | EPE / of zero, px | llr > 1 in plumes "
          "| outside |\n|" + "---|" * 7)  # fmt: skip
    for kind in sorted(tallies, key=KINDS.index):
        for row in tallies[kind].rows():
            print(f"| {kind} | {row} |", flush=True)
    print_reliability(tallies)
