"""Where the frames of a run come from."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from locate.pipeline import source
from locate.pipeline.config import RunConfig
from locate.pipeline.source import RecordingSource
from locate.recording import KeyFrame, KeyFrames
from locate.recording.opening import open_recording


@pytest.fixture
def pages(tmp_path: Path) -> Path:
    """A TIFF of three pages: reading them leaves a note."""
    noise = np.random.default_rng(0).integers(0, 256, (3, 48, 64), dtype=np.uint8)
    cv2.imwritemulti(str(tmp_path / "pages.tif"), list(noise))
    return tmp_path / "pages.tif"


def test_a_recording_is_opened_once(pages: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []

    def count(path: Path, **options: bool) -> object:
        opened.append(path)
        return open_recording(path, **options)

    monkeypatch.setattr(source, "open_recording", count)
    given = RecordingSource.of(RunConfig(recording=pages, focal_px=100))
    frame = KeyFrame(index=0, time_s=0.0, source="", sharpness=1.0, motion_px=0.0)
    key_frames = KeyFrames(frames=(frame,), width=32, height=24, is_video=True, static=False)
    given.open_frames()
    given.open_frames()
    assert given.focal_prior_px(key_frames) == 50
    assert opened == [pages]


def test_each_reader_of_a_recording_has_its_own_warnings(pages: Path) -> None:
    given = RecordingSource.of(RunConfig(recording=pages))
    first, second = given.open_frames(), given.open_frames()
    assert len(list(first.frames())) == 3
    assert len(first.warnings) == 1
    assert second.warnings == given.open_frames().warnings == []
