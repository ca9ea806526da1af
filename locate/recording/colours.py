"""Frames in colour, to be looked at; everything that measures works on grey ones."""

from collections.abc import Collection, Iterator, Mapping
from itertools import repeat
from pathlib import Path

import cv2
import numpy as np

from geometry.arrays import FloatArray, Picture
from geometry.regular_files import read_content
from locate.recording.formats import PhotoKind, kind_of_photo
from locate.recording.images import distortion_map
from locate.recording.posed_frames import PosedFrames
from locate.recording.recording import Recording, turn_image
from locate.recording.video import video_pictures


def undistorted_pictures(
    recording: Recording, posed: PosedFrames, rows: Collection[int], times_s: FloatArray
) -> Iterator[tuple[int, Picture]]:
    """Some of the frames of a run in colour, as its pinhole camera would have taken them.

    Args:
        recording: Where they come from.
        posed: The frames of the run.
        rows: Which of them, rising.
        times_s: (N,) of all frames of the run, from the start of the recording.

    Yields:
        Row and picture, (H, W, 3) blue, green, red; grey where the recording holds no colour that
        can be read.
    """
    grey = posed.undistorted().images
    place = distortion_map(posed.camera)
    size = (posed.camera.width, posed.camera.height)
    wanted = {int(posed.indices[row]): float(times_s[row]) for row in rows}
    coloured = _coloured_frames(recording, wanted)
    ahead: tuple[int, Picture] | None = None
    for row in rows:
        index = int(posed.indices[row])
        while ahead is None or ahead[0] < index:
            ahead = next(coloured)
        if ahead[0] > index:
            yield row, np.asarray(cv2.cvtColor(grey[row], cv2.COLOR_GRAY2BGR), dtype=np.uint8)
            continue
        picture = cv2.resize(ahead[1], size, interpolation=cv2.INTER_AREA)
        if place is not None:
            picture = cv2.remap(picture, place, None, cv2.INTER_LINEAR)
        yield row, np.asarray(picture, dtype=np.uint8)


def _coloured_frames(
    recording: Recording, times_s: Mapping[int, float]
) -> Iterator[tuple[int, Picture]]:
    """Those frames that can be read in colour, by their index; at the end one beyond all."""
    if recording.read is None and recording.stretch is None:
        if recording.is_video:
            yield from video_pictures(recording.path, times_s)
        else:
            yield from _coloured_photos(recording, times_s)
    yield from repeat((1 << 62, np.zeros((0, 0, 3), np.uint8)))


def _coloured_photos(
    recording: Recording, indices: Collection[int]
) -> Iterator[tuple[int, Picture]]:
    places = recording.photo_indices or range(len(recording.photos))
    for position, (index, photo) in enumerate(zip(places, recording.photos, strict=True)):
        picture = _read_colour(photo) if index in indices else None
        if picture is not None:
            turned = turn_image(picture, recording.turns.get(position, 0))
            yield index, np.asarray(turned, dtype=np.uint8)


def _read_colour(photo: Path) -> Picture | None:
    try:
        content = read_content(photo)
        if not content or kind_of_photo(photo, content) is not PhotoKind.PLAIN:
            return None  # of raw photos OpenCV would read the preview
        picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    except (OSError, cv2.error):
        return None
    return None if picture is None else np.asarray(picture, dtype=np.uint8)
