"""Tracks of features through a recording whose motion is known, and how COLMAP is told of them."""

from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest

from geometry.sfm.features import read_pairs
from geometry.sfm.track_matches import FarMatches, write_tracks
from geometry.sfm.tracks import MIN_SHARED, BrokenTracksError, TrackedFrame, follow_features

SIZE = (320, 240)
CENTRE = np.array([160.0, 120.0])
COUNT = 14
WALL_PX, BARS_PX = 2.37, 5.1


def photo(seed: int) -> np.ndarray:
    """Detail at every scale, larger than a frame."""
    random = np.random.default_rng(seed)
    total = np.zeros((480, 640), np.float32)
    for size in (12, 40, 120, 240):
        coarse = random.normal(size=(size, size)).astype(np.float32)
        total += cv2.resize(coarse, (640, 480), interpolation=cv2.INTER_CUBIC)
    return cv2.normalize(total, None, 10, 245, cv2.NORM_MINMAX).astype(np.uint8)


def motion(i: int) -> np.ndarray:
    """(2, 3) from the place in the first frame to that in frame `i`: shift, turn and growth."""
    scale, angle = 1 + 0.0005 * i, np.radians(0.05 * i)
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.column_stack([turn, CENTRE - turn @ CENTRE + i * np.array([2.37, 0.61])])


def film(skin: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    shifted = matrix.copy()
    shifted[:, 2] -= matrix[:, :2] @ np.array([160, 120])
    return cv2.warpAffine(skin, shifted, SIZE, flags=cv2.INTER_CUBIC)


@pytest.fixture(scope="module")
def recording() -> list[np.ndarray]:
    skin, random = photo(1), np.random.default_rng(2)
    frames = [film(skin, motion(i)) for i in range(COUNT)]
    noisy = [frame + random.normal(scale=1.0, size=frame.shape) for frame in frames]
    return [np.clip(frame, 0, 255).round().astype(np.uint8) for frame in noisy]


def test_tracks_keep_to_their_feature_to_a_tenth_of_a_pixel(recording: list[np.ndarray]) -> None:
    frames = follow_features(recording)
    _, first, last = np.intersect1d(frames[0].ids, frames[-1].ids, return_indices=True)
    matrix = motion(COUNT - 1)
    expected = frames[0].pixels[first] @ matrix[:, :2].T + matrix[:, 2]
    errors = np.linalg.norm(frames[-1].pixels[last] - expected, axis=1)
    assert len(errors) >= MIN_SHARED
    assert np.median(errors) < 0.08
    assert np.quantile(errors, 0.9) < 0.16


def bars_before_wall(count: int) -> list[np.ndarray]:
    """The camera goes sideways: the wall moves by `WALL_PX` a frame, the bars by `BARS_PX`."""
    wall, bars, frames = photo(1), photo(3), []
    bar = np.tile((np.arange(640) // 20 % 3 == 0).astype(np.float32), (480, 1))
    for i in range(count):
        behind, before = (np.array([[1.0, 0, px * i], [0, 1, 0]]) for px in (WALL_PX, BARS_PX))
        share = film(bar, before)
        frame = share * film(bars, before) + (1 - share) * film(wall, behind)
        frames.append(frame.round().clip(0, 255).astype(np.uint8))
    return frames


def displacements(frames: list[np.ndarray]) -> np.ndarray:
    """(M, 2) from the first frame to the last, of what is in both."""
    found = follow_features(frames)
    _, first, last = np.intersect1d(found[0].ids, found[-1].ids, return_indices=True)
    return found[-1].pixels[last] - found[0].pixels[first]


def test_what_slides_along_the_edge_of_something_near_is_dropped() -> None:
    """Where an edge of a bar meets the wall, a corner belongs to neither."""
    moved = displacements(bars_before_wall(10))
    off = [np.linalg.norm(moved - [9 * px, 0], axis=1) for px in (WALL_PX, BARS_PX)]
    assert np.mean(np.minimum(*off) > 0.5) < 0.2


def test_what_moves_on_its_own_is_dropped() -> None:
    """A picture that goes up where all else goes sideways: a fifth of the image."""
    frames = bars_before_wall(5)
    for i, frame in enumerate(frames):
        frame[60 - 4 * i : 190 - 4 * i, 180:300] = photo(5)[:130, :120]
    assert np.mean(np.abs(displacements(frames)[:, 1]) > 2) < 0.02


def test_a_cut_breaks_tracks(recording: list[np.ndarray]) -> None:
    read = []
    other = [film(photo(9), motion(i)) for i in range(4)]

    def images() -> object:
        for image in [*recording[:4], *other]:
            read.append(image)
            yield image

    with pytest.raises(BrokenTracksError, match="key frames 3 and 4 share"):
        follow_features(images())
    assert len(read) == 5


def test_features_that_last_two_frames_only_are_no_tracks() -> None:
    """One half of the picture changes with every frame, by turns, as between photos taken apart."""
    skins = [photo(seed)[:240, :320] for seed in range(10, 15)]
    frames = [np.hstack([skins[i // 2][:, :160], skins[(i + 1) // 2][:, 160:]]) for i in range(8)]
    with pytest.raises(BrokenTracksError, match="three key frames share"):
        follow_features(frames)


def test_blank_frames_have_no_tracks() -> None:
    with pytest.raises(BrokenTracksError, match="key frames 0 and 1 share 0"):
        follow_features([np.full((240, 320), 90, np.uint8)] * 4)


def test_matches_of_tracks_and_of_far_frames_share_a_database(tmp_path: Path) -> None:
    """Points before a moving camera, 80 as tracks and others that SIFT found again."""
    random = np.random.default_rng(4)
    points = random.uniform([-3, -2, 5], [3, 2, 9], (130, 3))
    seen = [points - [0.1 * i, 0, 0] for i in range(9)]
    pixels = [300 * p[:, :2] / p[:, 2:] + CENTRE for p in seen]
    frames = [TrackedFrame(ids=np.arange(80) + 5, pixels=p[:80]) for p in pixels]
    far = FarMatches(
        keypoints={0: pixels[0][80:] + 0.5, 8: pixels[8][:79:-1] + 0.5},
        pairs={
            (0, 8): (
                np.column_stack([np.arange(50), np.arange(50)[::-1]]).astype(np.uint32),
                pycolmap.TwoViewGeometry(),
            )
        },
    )
    names = [f"{i}.png" for i in range(9)]
    camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_RADIAL", 300, *SIZE)
    shares: list[float] = []
    write_tracks(tmp_path / "a.db", names, camera, frames, far, shares.append)
    pairs = {(pair.first, pair.second): pair for pair in read_pairs(tmp_path / "a.db", names)}
    assert sorted({b - a for a, b in pairs}) == [1, 2, 4, 8]
    assert len(pairs[0, 4].pixels) == 80
    np.testing.assert_allclose(pairs[0, 8].pixels[:, 0], pixels[0] + 0.5, atol=1e-3)
    np.testing.assert_allclose(pairs[0, 8].pixels[:, 1], pixels[8] + 0.5, atol=1e-3)
    assert shares[-1] == 1
