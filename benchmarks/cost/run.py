"""What a run costs: CPU and wall seconds of every stage, and the peak memory.

    python -m benchmarks.cost run                # the bundled sample, 60 frames of 640x480
    python -m benchmarks.cost run video.mp4 -o out    # and keep the run

Prints a row for each stage, then the CPU seconds of all and the peak memory.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.common.cost import children_cpu_s, children_peak_mib
from locate.recording.sample import SAMPLE_VIDEO

STAGES = ("frames", "poses", "place", "detections", "fusion", "report")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, nargs="?", default=SAMPLE_VIDEO)
    parser.add_argument("-o", "--output", type=Path)


def main(options: argparse.Namespace) -> None:
    with tempfile.TemporaryDirectory() as folder:
        output = options.output or Path(folder) / "run"
        command = [sys.executable, "-m", "locate", "run", options.recording, "-o", output]
        subprocess.run(command, check=True, capture_output=True)
        print(f"{'stage':10s} | CPU s | wall s | note        ({os.cpu_count()} cores)")
        for stage in STAGES:
            stamp = output / ".stages" / f"{stage}.json"
            if stamp.exists():
                time = json.loads(stamp.read_text())["time"]
                print(
                    f"{stage:10s} | {time['cpu_s']:5.1f} | {time['wall_s']:6.1f} | {time['note']}"
                )
    print(f"in all     | {children_cpu_s():5.1f} CPU s, start-up included")
    print(f"peak memory | {children_peak_mib():.0f} MB")
