"""The note on key frames without a pose."""

import numpy as np
import pytest

from locate.pipeline.left_out import left_out_notes
from locate.recording import KeyFrame, KeyFrames


def key_frames(count: int, *, is_video: bool = True, blurred: tuple[int, ...] = ()) -> KeyFrames:
    frames = tuple(
        KeyFrame(
            index=2 * row,
            time_s=0.1 * row,
            source="flight.mp4" if is_video else f"IMG_{row}.jpg",
            sharpness=10.0 if row in blurred else 100.0,
            motion_px=3.0,
        )
        for row in range(count)
    )
    return KeyFrames(frames=frames, width=320, height=240, is_video=is_video, static=False)


def without(count: int, *missing: int) -> np.ndarray:
    return np.array([2 * row for row in range(count) if row not in missing])


@pytest.mark.parametrize("given", [True, False])
def test_a_map_of_all_frames_has_no_note(given: bool) -> None:
    assert left_out_notes(key_frames(10), without(10), given=given) == ()


def test_frames_of_a_video_are_counted_and_named_by_their_times() -> None:
    (note,) = left_out_notes(key_frames(64), without(64, 3, *range(40, 64)), given=False)
    assert note == (
        "25 of 64 key frames are left out, at 0.30 s, from 4.00 to 6.30 s: structure from motion "
        "found too little in them that the others show."
    )


def test_blurred_frames_are_told() -> None:
    frames = key_frames(20, blurred=(5, 6, 7))
    (note,) = left_out_notes(frames, without(20, 5, 6, 9), given=False)
    assert "3 of 20" in note
    assert "2 of them are blurred" in note


def test_poses_off_the_path_of_a_video_do_not_count_as_given() -> None:
    (note,) = left_out_notes(key_frames(60), without(60, 10, 40), given=True)
    assert note.startswith("2 of 60 key frames are left out")
    assert note.endswith("no pose that lies on the path was given for them.")


def test_photos_are_named_and_many_are_counted() -> None:
    frames = key_frames(30, is_video=False)
    (note,) = left_out_notes(frames, without(30, 0, 4), given=True)
    assert note == (
        "2 of 30 key frames are left out, IMG_0.jpg, IMG_4.jpg: no pose was given for them."
    )
    (note,) = left_out_notes(frames, without(30, *range(10)), given=True)
    assert "IMG_5.jpg and 4 more" in note
