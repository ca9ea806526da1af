"""A video is read as a player shows it: from its start, in its shape, whole and unmirrored."""

import os
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from locate.recording import Frame, open_recording, select_frames
from locate.recording.display import PictureGeometry
from locate.telemetry import read_telemetry
from tests.locate import recorded
from tests.locate.test_video import pan

RATE, HEIGHT, WIDTH = 25, 96, 128
QUARTERS = {
    "upright": (1, 0, 0, 1),
    "right": (0, 1, -1, 0),
    "over": (-1, 0, 0, -1),
    "left": (0, -1, 1, 0),
    "mirrored": (-1, 0, 0, 1),
    "upside down": (1, 0, 0, -1),
    "transposed": (0, 1, 1, 0),
    "transversed": (0, -1, -1, 0),
}
"""Display matrices a, b, c, d: a point (x, y), y down, is shown at (a x + c y, b x + d y)."""


def quadrants(width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """Four grey levels: 40, 90 above 140, 200."""
    levels = np.array([[40, 90], [140, 200]], np.uint8)
    return np.repeat(np.repeat(levels, height // 2, 0), width // 2, 1)


def write(
    path: Path,
    images: Sequence[np.ndarray],
    *,
    codec: str = "ffv1",
    start_s: float = 0.0,
    matrix: tuple[int, ...] | None = None,
    aspect: Fraction | None = None,
    fields: str | None = None,
    subtitles: Sequence[str] = (),
) -> Path:
    """A video of grey images, 25 a second; its clock begins at `start_s`.

    `fields` is tff or bff where the rows of the first field are even or odd.
    """
    options = {"flags": "+ilme+ildct"} if fields else {}
    with av.open(str(path.absolute()), "w", options={"avoid_negative_ts": "disabled"}) as container:
        stream = container.add_stream(codec, rate=RATE, options=options)
        stream.height, stream.width = images[0].shape
        stream.bit_rate = 8_000_000
        stream.pix_fmt = "gray" if codec == "ffv1" else "yuv420p"
        stream.codec_context.time_base = Fraction(1, RATE)
        if aspect is not None:
            stream.sample_aspect_ratio = aspect
            stream.codec_context.sample_aspect_ratio = aspect
        if matrix is not None:
            a, b, c, d = (value * 2**16 for value in matrix)
            stream.set_display_matrix([a, b, 0, c, d, 0, 0, 0, 2**30])
        track: Any = container.add_mux_stream("subrip") if subtitles else None
        if track is not None:
            track.time_base = Fraction(1, 1000)
        for i, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format=stream.pix_fmt)
            frame = mark_fields(frame, fields) if fields else frame
            frame.pts = round(start_s * 1000) + i * 1000 // RATE
            frame.time_base = Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
        for i, text in enumerate(subtitles):
            packet = av.Packet(text.encode())
            packet.stream, packet.time_base, packet.duration = track, Fraction(1, 1000), 1000
            packet.pts = packet.dts = round(start_s * 1000) + 1000 * i
            container.mux(packet)
    return path


def mark_fields(frame: av.VideoFrame, order: str) -> av.VideoFrame:
    graph = av.filter.Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=Fraction(1, 1000)
    )
    graph.link_nodes(source, graph.add("setfield", order), graph.add("buffersink")).configure()
    graph.vpush(frame)
    return graph.vpull()


def frames_of(path: Path) -> tuple[list[Frame], list[str]]:
    recording = open_recording(path)
    return list(recording.frames()), recording.warnings


@pytest.mark.parametrize(
    ("name", "codec", "start_s"),
    [
        ("a.ts", "libx264", 0.0),
        ("a.ts", "mpeg2video", 7.0),
        ("a.MTS", "libx264", 1.4),
        ("a.mkv", "ffv1", 1.4),
        ("a.mkv", "libx264", 3600.0),
        ("a.mp4", "libx264", 1.4),
        ("a.mov", "libx264", 1.4),
        ("a.mkv", "ffv1", 0.0),
    ],
)
def test_times_count_from_the_first_frame(
    tmp_path: Path, name: str, codec: str, start_s: float
) -> None:
    frames, notes = frames_of(write(tmp_path / name, pan([0.0] * 20), codec=codec, start_s=start_s))
    assert [frame.time_s for frame in frames] == pytest.approx(np.arange(20) / RATE, abs=1e-3)
    assert notes == []


def test_frames_before_an_edit_list_begins_are_not_shown(tmp_path: Path) -> None:
    images = [np.full((HEIGHT, WIDTH), 40 + 8 * i, np.uint8) for i in range(20)]
    frames, notes = frames_of(write(tmp_path / "a.mp4", images, codec="libx264", start_s=-0.2))
    assert len(frames) == 15
    assert [frame.time_s for frame in frames] == pytest.approx(np.arange(15) / RATE, abs=1e-3)
    assert frames[0].image.mean() == pytest.approx(images[5].mean(), abs=3)
    assert notes == []


@pytest.mark.parametrize("start_s", [0.0, 1.4])
def test_subtitles_share_the_clock_of_the_frames(tmp_path: Path, start_s: float) -> None:
    video = tmp_path / "a.mkv"
    write(video, pan([0.0] * 20), start_s=start_s, subtitles=recorded.SRT.split("\n\n"))
    frames, _ = frames_of(video)
    assert frames[0].time_s == 0
    assert read_telemetry(video).times_s == pytest.approx([0, 1])


@pytest.mark.parametrize(
    ("aspect", "size"),
    [
        (Fraction(4, 3), (171, 96)),
        (Fraction(1, 2), (128, 192)),
        (Fraction(1000, 1001), (128, 96)),
        (Fraction(1), (128, 96)),
    ],
)
@pytest.mark.parametrize(("name", "codec"), [("a.mp4", "libx264"), ("a.mkv", "libx264")])
def test_pixels_become_square(
    tmp_path: Path, name: str, codec: str, aspect: Fraction, size: tuple[int, int]
) -> None:
    path = write(tmp_path / name, [quadrants()] * 3, codec=codec, aspect=aspect)
    recording = open_recording(path)
    assert recording.sizes.source == size
    frames = list(recording.frames())
    assert frames[0].image.shape == size[::-1]
    height, width = frames[0].image.shape
    assert frames[0].image[height // 4, width // 4] == pytest.approx(40, abs=3)
    assert frames[0].image[-height // 4, -width // 4] == pytest.approx(200, abs=3)
    resampled = size != (WIDTH, HEIGHT)
    assert ["not square" in note for note in recording.warnings] == [True] * resampled


def test_pixels_are_square_before_they_are_turned(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.mp4",
        [quadrants()] * 3,
        codec="libx264",
        aspect=Fraction(3, 2),
        matrix=QUARTERS["right"],
    )
    frames, _ = frames_of(path)
    assert frames[0].image.shape == (192, 96)


@pytest.mark.parametrize("turn", QUARTERS)
def test_display_matrices_turn_and_mirror(tmp_path: Path, turn: str) -> None:
    path = write(tmp_path / "a.mp4", [quadrants()] * 3, codec="libx264", matrix=QUARTERS[turn])
    frames, notes = frames_of(path)
    shown = frames[0].image
    a, b, c, d = QUARTERS[turn]
    for x, y, level in ((-1, -1, 40), (1, -1, 90), (-1, 1, 140), (1, 1, 200)):
        height, width = shown.shape
        column = width // 2 + (a * x + c * y) * width // 4
        row = height // 2 + (b * x + d * y) * height // 4
        assert shown[row, column] == pytest.approx(level, abs=4)
    assert shown.shape == ((WIDTH, HEIGHT) if a == 0 else (HEIGHT, WIDTH))
    assert ["mirrors" in note for note in notes] == [True] * (a * d - b * c < 0)


def test_a_slanted_display_matrix_is_noted() -> None:
    slanted = np.array([[0.8, -0.6], [0.6, 0.8]])
    geometry = PictureGeometry(aspect=Fraction(1), shown_from_stored=slanted)
    (note,) = geometry.describe(quadrants())
    assert "no quarter turn" in note
    np.testing.assert_array_equal(geometry.show(quadrants()), quadrants())


def weave(even: np.ndarray, odd: np.ndarray) -> np.ndarray:
    """A frame of two fields: the even rows of one image and the odd rows of another."""
    both = even.copy()
    both[1::2] = odd[1::2]
    return both


def combing(image: np.ndarray) -> float:
    """How much the rows of two parities differ, against rows of the same."""
    rows = image.astype(float)
    return float(np.abs(rows[2:] - 2 * rows[1:-1] + rows[:-2]).mean())


@pytest.mark.parametrize("fields", ["tff", "bff"])
@pytest.mark.parametrize(
    ("name", "codec"), [("a.MTS", "libx264"), ("a.mpg", "mpeg2video"), ("a.mkv", "libx264")]
)
def test_interlaced_frames_lose_their_combs(
    tmp_path: Path, name: str, codec: str, fields: str
) -> None:
    images = [cv2.GaussianBlur(image, (0, 0), 2.0) for image in pan([4.0 * i for i in range(40)])]
    first, second = images[::2], images[1::2]
    even, odd = (first, second) if fields == "tff" else (second, first)
    woven = [weave(*pair) for pair in zip(even, odd, strict=True)]
    frames, notes = frames_of(write(tmp_path / name, woven, codec=codec, fields=fields))
    assert len(frames) == len(woven)
    assert [frame.time_s for frame in frames] == pytest.approx(np.arange(20) / RATE, abs=1e-3)
    assert ["interlaced" in note for note in notes] == [True]
    for frame, mixed, clean in list(zip(frames, woven, first, strict=True))[2:-2]:
        assert combing(frame.image) < 0.3 * combing(mixed)
        assert np.abs(frame.image.astype(float) - clean).mean() < 4


def test_an_interlaced_video_is_noted_once_for_its_map(tmp_path: Path) -> None:
    path = tmp_path / "a.MTS"
    images = pan([4.0 * i for i in range(40)])
    woven = [weave(*pair) for pair in zip(images[::2], images[1::2], strict=True)]
    write(path, woven, codec="libx264", fields="tff")
    kept = select_frames(open_recording(path), tmp_path / "frames")
    assert len(kept.warnings) == 1


@pytest.mark.parametrize("name", [b"12:30:05.mkv", b"caf\xe9.mkv", b"100%d.mkv", b"file:a.mkv"])
def test_any_file_name_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: bytes
) -> None:
    write(tmp_path / "plain.mkv", pan([0.0] * 3))
    monkeypatch.chdir(tmp_path)
    video = Path("plain.mkv").rename(os.fsdecode(name))
    frames, notes = frames_of(video)
    assert len(frames) == 3
    assert notes == []


def test_subtitles_are_read_from_a_file_with_colons(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("12:30:05.mkv"), pan([0.0] * 3), subtitles=recorded.SRT.split("\n\n"))
    assert len(read_telemetry(Path("12:30:05.mkv"))) == 2


def test_frames_lost_in_the_middle_of_a_stream_are_noted(tmp_path: Path) -> None:
    path = write(tmp_path / "a.ts", pan([8.0 * i for i in range(40)]), codec="mpeg2video")
    content = path.read_bytes()
    packets = [content[i : i + 188] for i in range(0, len(content), 188)]
    count = len(packets)
    (tmp_path / "b.ts").write_bytes(b"".join(packets[: count // 3] + packets[count // 2 :]))
    frames, notes = frames_of(tmp_path / "b.ts")
    assert len(frames) < 38
    assert any("frames are lost" in note or "damaged" in note for note in notes)
    assert frames_of(path)[1] == []


def test_uneven_frames_are_noted(tmp_path: Path) -> None:
    images = [quadrants()] * 12
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=RATE)
        stream.height, stream.width = images[0].shape
        stream.pix_fmt = "gray"
        for i, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="gray")
            frame.pts, frame.time_base = 40 * i + (360 if i > 7 else 0), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    _, (note,) = frames_of(tmp_path / "a.mkv")
    assert "1 of its 11 steps between frames are over 2.5 times" in note
    assert "the longest 0.40 s, at 0.28 s" in note
