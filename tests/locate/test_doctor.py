"""What `locate doctor` says of the program and of recordings."""

import shutil
from importlib import metadata
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from geometry.errors import BadInputError
from locate.commands.app import app
from locate.pipeline.effort import EFFORTS
from locate.planning import duration, installed
from locate.planning.duration import estimate_run_time
from locate.planning.file_facts import odd_things
from locate.planning.installed import Extra, list_extras
from locate.planning.prospect import RANGES_M, strengths_px
from locate.recording import open_recording
from locate.recording.sample import SAMPLE_VIDEO
from locate.recording.writer import create_video

SRT = (
    "1\n00:00:00,000 --> 00:00:01,000\n[latitude: 47.1] [longitude: 8.2] [rel_alt: 9 abs_alt: 9]\n"
)


def test_extras_are_those_of_the_package_and_name_what_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    required = ["numpy>=2", 'gpxpy>=1.6; extra == "gpx"', 'a-b[c]>=1; extra == "dds"',
                'numpy>=2; extra == "dds"', 'ruff; extra == "dev"']  # fmt: skip
    monkeypatch.setattr(metadata, "requires", lambda _: required)
    there = {"numpy": "2.1", "gpxpy": "1.6"}
    monkeypatch.setattr(installed, "version_of", there.get)
    assert list_extras() == [Extra(name="gpx", missing=()), Extra(name="dds", missing=("a-b",))]


def test_without_being_installed_there_are_no_extras(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installed, "DISTRIBUTION", "no-such-distribution")
    assert list_extras() == []


def examined(path: Path) -> str:
    result = CliRunner().invoke(app, ["doctor", str(path)], env={"COLUMNS": "100"})
    assert result.exit_code == 0, result.output
    return result.output


def test_a_video_is_described(tmp_path: Path) -> None:
    video = tmp_path / "film.mkv"
    shutil.copy(SAMPLE_VIDEO, video)
    (tmp_path / "film.srt").write_text(SRT)
    said = examined(video)
    for words in ("640x480 px", "15.00 frames a second", "ffv1", "film.srt, 1 positions"):
        assert words in said
    assert "A run takes about" in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["film.mkv", "film.srt"]


def test_what_is_odd_is_said(tmp_path: Path) -> None:
    video = tmp_path / "coded.mp4"
    still = np.full((240, 320), 90, np.uint8)
    with create_video(video, size=(320, 240), fps=5) as writer:
        for _ in range(8):
            writer.write(still)
    odd = " ".join(odd_things(open_recording(video)))
    assert "only 8 frames" in odd
    assert "bits a pixel" in odd
    assert "5.0 frames a second" in odd
    assert list(odd_things(open_recording(SAMPLE_VIDEO))) == []


def test_a_run_of_more_takes_longer() -> None:
    recording = open_recording(SAMPLE_VIDEO)
    few, many = (estimate_run_time(recording, EFFORTS[effort]) for effort in ("quick", "thorough"))
    assert few.detections_s < many.detections_s
    total = many.frames_s + many.poses_s + many.detections_s + many.rest_s
    assert many.total_s == pytest.approx(total)


def test_poses_of_photos_take_longer_than_those_of_a_video(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(duration, "_timed", lambda _: duration.REFERENCE_S)
    image = np.full((48, 64), 90, np.uint8)
    photos, video = tmp_path / "photos", tmp_path / "video.mkv"
    photos.mkdir()
    with create_video(video, size=(64, 48), fps=5) as writer:
        for number in range(3):
            cv2.imwrite(str(photos / f"{number}.png"), image)
            writer.write(image)
    by_sift, by_tracks = (
        estimate_run_time(open_recording(path), EFFORTS["usual"]) for path in (photos, video)
    )
    assert by_sift.poses_s == pytest.approx(duration.SIFT_FACTOR * by_tracks.poses_s)


def test_usual_plumes_are_weaker_from_farther() -> None:
    for values in strengths_px((1280, 720), 1000.0, "video").values():
        assert len(values) == len(RANGES_M)
        assert values == sorted(values, reverse=True)


def test_what_is_no_recording_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no video")
    result = CliRunner().invoke(app, ["doctor", str(tmp_path / "notes.txt")])
    assert isinstance(result.exception, BadInputError)
    assert "\n" not in str(result.exception)
