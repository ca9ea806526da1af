"""Videos of any length at the price of a short one: its coded packets again and again."""

from collections.abc import Sequence
from fractions import Fraction
from itertools import chain
from pathlib import Path

import av

from geometry.arrays import GreyImage
from locate.recording.writer import H264, create_video

FPS = 30


def write_unit(path: Path, images: Sequence[GreyImage]) -> Path:
    """The frames to and fro, coded as one closed group, so that a repetition shows no cut."""
    turned = [*images, *images[-2:0:-1]]
    options = {"preset": "veryfast", "crf": "28", "g": str(len(turned)), "bf": "0"}
    height, width = images[0].shape
    with create_video(path, size=(width, height), fps=FPS, codec=H264, options=options) as video:
        for image in turned:
            video.write(image)
    return path


def loop_video(unit: Path, path: Path, frames: int) -> Path:
    """A video of so many frames, of the packets of a unit with times of their own."""
    with av.open(str(unit)) as source, av.open(str(path), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        packets = [packet for packet in source.demux(video=0) if packet.size]
        coded = [(bytes(packet), packet.is_keyframe) for packet in packets]
        whole, rest = divmod(frames, len(coded))
        for number, (content, is_key) in enumerate(chain(*[coded] * whole, coded[:rest])):
            packet = av.Packet(content)
            packet.stream, packet.time_base = stream, Fraction(1, FPS)
            packet.pts = packet.dts = number
            packet.duration, packet.is_keyframe = 1, is_key
            target.mux(packet)
    return path
