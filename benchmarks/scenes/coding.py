"""Recordings of a scene coded as cameras do it, made of the lossless one."""

import argparse
from pathlib import Path

from geometry.errors import BadInputError
from locate.recording import open_recording
from locate.recording.opening import ANY_SIDE
from locate.recording.writer import H264, H265
from locate.simulation.compression import write_coded

CODECS = {"h264": H264, "h265": H265}
LOSSLESS, USUAL = "lossless", "usual"


def code(lossless: Path, coding: str) -> Path:
    """The recording in that coding, beside the lossless one; made where it does not stand yet."""
    if coding == LOSSLESS:
        return lossless
    coded = lossless.with_name(f"{coding}.mp4")
    if not coded.exists():
        codec, _, bits = coding.partition("_")
        if codec not in CODECS or not bits.replace(".", "", 1).isdecimal():
            known = " or ".join(CODECS)
            raise BadInputError(f"{coding}: no coding; give {LOSSLESS}, or {known} as h264_0.2")
        recording = open_recording(lossless, max_side=ANY_SIDE)
        frames = list(recording.frames())
        fps = (len(frames) - 1) / (frames[-1].time_s - frames[0].time_s)
        images = [frame.image for frame in frames]
        write_coded(coded, images, fps, codec=CODECS[codec], bits_per_pixel=float(bits))
    return coded


def run_folder(recording: Path, effort: str = USUAL) -> Path:
    """Where a run of it is kept, beside it."""
    return recording.with_name(f"run_{recording.stem}_{effort}")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """`--codings` and `--effort`."""
    parser.add_argument("--codings", nargs="+", default=[LOSSLESS], help="h264_0.2, h265_0.1")
    parser.add_argument("--effort", default=USUAL)
