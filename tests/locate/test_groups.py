"""Chosen frames of a video are those that decoding all gives, and few others are decoded."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from locate.recording import groups, open_recording
from locate.recording.index import KeyFrame
from locate.recording.motion import measure_sharpness
from locate.recording.recording import Frame, Recording
from locate.recording.video import video_pictures
from locate.recording.writer import H264, H265, create_video
from tests.locate.test_video import pan

COUNT, GROUP = 60, 10
X265 = f"keyint={GROUP}:min-keyint={GROUP}:bframes=3:log-level=none"
CODINGS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "closed": (H264, {"g": f"{GROUP}", "bf": "2", "x264-params": "open-gop=0:scenecut=0"}),
    "open": (H264, {"g": f"{GROUP}", "bf": "3", "x264-params": "open-gop=1:scenecut=0"}),
    "one": (H264, {"g": "250", "bf": "2"}),
    "h265 open": (H265, {"x265-params": f"{X265}:open-gop=1"}),
    "h265 closed": (H265, {"x265-params": f"{X265}:open-gop=0"}),
    "refresh": (H264, {"g": f"{GROUP}", "bf": "0", "x264-params": "intra-refresh=1"}),
    "interlaced": (H264, {"g": f"{GROUP}", "x264-params": "tff=1"}),
}


def write(folder: Path, coding: str) -> Recording:
    codec, options = CODINGS[coding]
    path = folder / f"{coding}.mp4"
    images = pan([1.5 * i for i in range(COUNT)])
    size = (images[0].shape[1], images[0].shape[0])
    with create_video(path, size=size, fps=30, codec=codec, options=options) as writer:
        for image in images:
            writer.write(image)
    return open_recording(path)


def look_at(frames: Iterable[Frame]) -> list[KeyFrame]:
    return [
        KeyFrame(
            index=frame.index,
            time_s=frame.time_s,
            source=frame.source,
            sharpness=measure_sharpness(frame.image),
            motion_px=0.0,
            is_b_frame=frame.is_b_frame,
        )
        for frame in frames
    ]


@pytest.mark.parametrize("coding", CODINGS)
def test_frames_read_again_are_the_same(tmp_path: Path, coding: str) -> None:
    recording = write(tmp_path, coding)
    frames = list(recording.frames())
    every = look_at(frames)
    for rows in ([0], [44, 45, 46], [9, 19, 28, 39, 49, 59], range(COUNT)):
        again = list(recording.frames_again([every[row] for row in rows]))
        assert [frame.index for frame in again] == list(rows)
        for frame in again:
            known = frames[frame.index]
            np.testing.assert_array_equal(frame.image, known.image)
            assert (frame.time_s, frame.is_b_frame) == (known.time_s, known.is_b_frame)


@pytest.mark.parametrize("coding", ["open", "h265 open", "interlaced"])
def test_pictures_are_those_of_their_frames(tmp_path: Path, coding: str) -> None:
    recording = write(tmp_path, coding)
    every = {frame.index: frame.time_s for frame in recording.frames()}
    pictures = dict(video_pictures(recording.path, {row: every[row] for row in (3, 44, 45, 58)}))
    known = dict(video_pictures(recording.path, every))
    assert list(pictures) == [3, 44, 45, 58]
    for row, picture in pictures.items():
        np.testing.assert_array_equal(picture, known[row])


@pytest.mark.parametrize(("coding", "most"), [("closed", GROUP), ("open", 2 * GROUP)])
def test_only_groups_of_chosen_frames_are_decoded(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, coding: str, most: int
) -> None:
    recording = write(tmp_path, coding)
    key = look_at(recording.frames())[45]
    decoded, decode = [], groups._decode_groups

    def counted(*arguments):
        for frame in decode(*arguments):
            decoded.append(frame.pts)
            yield frame

    monkeypatch.setattr(groups, "_decode_groups", counted)
    monkeypatch.setattr(Recording, "frames", None)
    (frame,) = recording.frames_again([key])
    assert frame.index == 45
    assert 1 <= len(decoded) <= most


@pytest.mark.parametrize("wrong", [{"time_s": 1.01}, {"sharpness": 3.0}])
def test_frames_that_are_not_found_are_those_of_decoding_all(
    tmp_path: Path, wrong: dict[str, float]
) -> None:
    recording = write(tmp_path, "closed")
    first, second, third = look_at(recording.frames())[29:32]
    again = list(recording.frames_again([first, replace(second, **wrong), third]))
    assert look_at(again) == [first, second, third]
