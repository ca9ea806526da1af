"""Of a long video not every frame is looked at, and what is kept is as good."""

from pathlib import Path

import numpy as np
import pytest

from locate.recording import open_recording, sampling
from locate.recording.display import PictureGeometry
from locate.recording.sampling import LookedAt
from locate.recording.video import NamedImage, video_images
from tests.locate.test_video import keep, pan, write_photos, write_video

FPS = 30
HOURS_2 = 2 * 3600 * FPS


def image_at(time_s: float, *, is_b_frame: bool = False) -> NamedImage:
    return NamedImage(time_s, "v.mkv", lambda: np.zeros((2, 2), np.uint8), is_b_frame)


def looked_at(count: int, *, fps: float = FPS, at_rest: bool = False, most: int = 120) -> list[int]:
    tell = LookedAt(count, most, lambda: at_rest)
    return [i for i in range(count) if tell(i, image_at(i / fps))]


def test_all_of_a_short_video_is_looked_at() -> None:
    assert looked_at(3600) == list(range(3600))


def test_two_hours_are_looked_at_five_times_a_second() -> None:
    found = looked_at(HOURS_2)
    assert len(found) < HOURS_2 / 5
    assert np.diff(found).max() / FPS < sampling.LONGEST_STEP_S + 2 / FPS


def test_a_video_of_few_frames_a_second_is_looked_at_whole() -> None:
    assert len(looked_at(7200, fps=4)) == 7200


def test_more_key_frames_ask_for_more_looks() -> None:
    assert len(looked_at(9000, most=300)) == 9000


def test_a_video_of_unknown_length_is_looked_at_whole() -> None:
    tell = LookedAt(0, 120, lambda: False)
    assert all(tell(i, image_at(i / FPS)) for i in range(9000))


def test_b_frames_are_looked_at_where_there_are_no_others() -> None:
    tell = LookedAt(18_000, 120, lambda: False)
    found = [i for i in range(18_000) if tell(i, image_at(i / FPS, is_b_frame=i % 4 != 0))]
    assert 2000 < len(found) <= 3600
    assert np.mean(np.array(found) % 4 == 0) > 0.9
    tell = LookedAt(18_000, 120, lambda: False)
    assert sum(tell(i, image_at(i / FPS, is_b_frame=i > 0)) for i in range(18_000)) >= 2000


def test_a_camera_at_rest_is_looked_at_closely_in_the_middle() -> None:
    middle = range(HOURS_2 // 2 - 100, HOURS_2 // 2 + 100)
    assert set(middle) <= set(looked_at(HOURS_2, at_rest=True))
    assert not set(middle) <= set(looked_at(HOURS_2))


@pytest.fixture
def few_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sampling, "ENOUGH", 30)
    monkeypatch.setattr(sampling, "FOR_EACH", 1)
    monkeypatch.setattr(sampling, "IN_A_ROW", 30)


@pytest.mark.usefixtures("few_looks")
def test_key_frames_of_a_long_video_are_spread_over_its_path(tmp_path: Path) -> None:
    video = write_video(tmp_path / "v.mkv", pan([2.0 * i for i in range(90)]))
    kept = keep(video, tmp_path, max_frames=10)
    assert len(kept) == 10
    assert set(kept.indices % 3) == {0}
    assert np.ptp(np.diff(kept.indices)) <= 3
    assert kept.indices[-1] >= 84


@pytest.mark.usefixtures("few_looks")
def test_half_of_a_long_still_video_is_kept_in_a_row_though_few_are_looked_at(
    tmp_path: Path,
) -> None:
    kept = keep(write_video(tmp_path / "v.mkv", pan([0.0] * 120)), tmp_path, max_frames=20)
    gaps = np.diff(kept.indices)
    assert kept.static
    assert len(kept) == 20
    assert np.count_nonzero(gaps == 1) >= 9
    assert gaps.max() < 3 * 120 / 20


def test_frames_that_are_not_wanted_are_counted_and_no_more(tmp_path: Path) -> None:
    images = pan([2.0 * i for i in range(6)])
    for recording in (
        open_recording(write_video(tmp_path / "v.mkv", images)),
        open_recording(write_photos(tmp_path / "photos", images)),
    ):
        found = list(recording.frames(lambda index, _: index in (1, 4)))
        assert [frame.index for frame in found] == [1, 4]
        for frame in found:
            np.testing.assert_array_equal(frame.image, images[frame.index])


def test_a_photo_that_is_not_wanted_is_not_read(tmp_path: Path) -> None:
    recording = open_recording(write_photos(tmp_path / "photos", pan([0.0, 2.0, 4.0])))
    recording.photos[1].unlink()
    assert [frame.index for frame in recording.frames(lambda index, _: index != 1)] == [0, 2]


def test_frames_of_a_video_do_not_stay_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    of = PictureGeometry.of.__func__

    def count(cls: type[PictureGeometry], *given: object) -> PictureGeometry:
        asked.append(given)
        return of(cls, *given)

    monkeypatch.setattr(PictureGeometry, "of", classmethod(count))
    path = write_video(tmp_path / "v.mkv", pan([0.0] * 20))
    assert len(list(video_images(path, []))) == 20
    assert len(asked) == 1
