"""The recording that comes with the package: a simulated hot leak on a pipe rack."""

from pathlib import Path

SAMPLE = Path(__file__).parents[1] / "data" / "sample"
SAMPLE_VIDEO = SAMPLE / "pipe_rack_leak.mkv"
