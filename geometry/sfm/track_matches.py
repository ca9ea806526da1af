"""Tracks as keypoints and verified matches in a COLMAP database, with SIFT matches of far frames.

Tracks tie a frame to those soon before and after it. Where a path comes back to what it saw before,
or flies strip beside strip, nothing but SIFT ties it together: that is done for few frames.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pycolmap
from numpy.typing import NDArray

from geometry.camera import HALF_PIXEL
from geometry.sfm.features import (
    SEQUENTIAL_OCTAVES,
    extract_features,
    image_ids,
    match_features,
    two_view_options,
)
from geometry.sfm.tracks import TrackedFrame
from geometry.threads import map_by_threads

MIN_MATCHES = 30
"""Fewest tracks that two frames must share to be a pair."""
GEOMETRY_MATCHES = 100
"""About how many of them the geometry of a pair is estimated from."""
FAR_STEP = 12
"""Least step between two frames that are matched by SIFT."""
FAR_FRAMES = 30
"""Most frames that are matched by SIFT, each with every other."""
UNUSABLE = (
    pycolmap.TwoViewGeometryConfiguration.UNDEFINED,
    pycolmap.TwoViewGeometryConfiguration.DEGENERATE,
)
Matches: TypeAlias = NDArray[np.uint32]
Keypoints: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class FarMatches:
    """SIFT matches of frames spread over a recording.

    Attributes:
        keypoints: (K, 2) positions by row of the frame, COLMAP's px.
        pairs: Matches, rows of keypoints, and the geometry, by rows of the two frames.
    """

    keypoints: dict[int, Keypoints]
    pairs: dict[tuple[int, int], tuple[Matches, pycolmap.TwoViewGeometry]]


def match_far_frames(
    database: Path, image_dir: Path, names: Sequence[str], camera: pycolmap.Camera
) -> FarMatches:
    """Matches frames spread evenly from the first to the last, each with every other.

    Args:
        database: Written and removed again.
        image_dir: Folder of the images.
        names: N file names in it, in order of time.
        camera: Of all images; what to start from.
    """
    last = len(names) - 1
    count = min(FAR_FRAMES, last // FAR_STEP + 1)
    if count < 2:
        return FarMatches(keypoints={}, pairs={})
    rows = np.linspace(0, last, count).round().astype(int).tolist()
    some = [names[row] for row in rows]
    extract_features(database, image_dir, some, camera, lambda _: None)
    match_features(database, sequential=False)
    with pycolmap.Database.open(database) as db:
        row_of = dict(zip(image_ids(db, some), rows, strict=True))
        keypoints = {
            row: np.asarray(db.read_keypoints(i), np.float32)[:, :2] for i, row in row_of.items()
        }
        pairs = {}
        for pair_id, geometry in zip(*db.read_two_view_geometries(), strict=True):
            first, second = (row_of[i] for i in pycolmap.pair_id_to_image_pair(pair_id))
            matches = np.asarray(geometry.inlier_matches, dtype=np.uint32)
            if len(matches):
                pairs[first, second] = (matches, geometry)
    database.unlink()
    return FarMatches(keypoints=keypoints, pairs=pairs)


def write_tracks(
    database: Path,
    names: Sequence[str],
    camera: pycolmap.Camera,
    frames: Sequence[TrackedFrame],
    far: FarMatches,
    on_share: Callable[[float], None],
    *,
    jobs: int = 1,
) -> None:
    """Writes frames and their tracks; frames 1, 2, 4, 8, ... steps apart become pairs.

    Tracks are verified from frame to frame already. A pair's geometry comes from an even selection
    of those it shares, and all of them become its matches: mapping drops those that do not fit.

    Args:
        database: Written anew.
        names: N file names.
        camera: Of all images; what to start from.
        frames: N frames of tracks.
        far: SIFT matches of some of them.
        on_share: Called with the share of the pairs done.
        jobs: Threads that find geometries side by side.
    """
    database.unlink(missing_ok=True)
    tracked = [(frame.pixels + HALF_PIXEL).astype(np.float32) for frame in frames]
    with pycolmap.Database.open(database) as db:
        ids = _write_images(db, names, camera)
        for row, points in enumerate(tracked):
            more = far.keypoints.get(row, np.zeros((0, 2), np.float32))
            db.write_keypoints(ids[row], np.concatenate([points, more.astype(np.float32)]))
        pairs = list(_pairs_of_tracks(frames))
        seen = set()
        geometries = map_by_threads(jobs, partial(_pair_geometry, camera, tracked), pairs)
        for done, ((first, second, matches), geometry) in enumerate(
            zip(pairs, geometries, strict=True)
        ):
            if first == 0:
                on_share(done / len(pairs))
            if geometry is None:
                continue
            seen.add((first, second))
            both = [matches]
            if (first, second) in far.pairs:
                both.append(_behind_tracks(far, tracked, first, second))
            _write_pair(db, ids[first], ids[second], np.concatenate(both), geometry)
        for (first, second), (_, geometry) in far.pairs.items():
            if (first, second) not in seen:
                matches = _behind_tracks(far, tracked, first, second)
                _write_pair(db, ids[first], ids[second], matches, geometry)
    on_share(1.0)


def _pairs_of_tracks(frames: Sequence[TrackedFrame]) -> Iterator[tuple[int, int, Matches]]:
    """Rows of two frames and the rows of their shared tracks."""
    for step in (2**k for k in range(SEQUENTIAL_OCTAVES)):
        for first in range(len(frames) - step):
            _, *rows = np.intersect1d(
                frames[first].ids,
                frames[first + step].ids,
                assume_unique=True,
                return_indices=True,
            )
            if len(rows[0]) >= MIN_MATCHES:
                yield first, first + step, np.stack(rows, axis=1).astype(np.uint32)


def _behind_tracks(
    far: FarMatches, tracked: Sequence[Keypoints], first: int, second: int
) -> Matches:
    """SIFT matches of a pair, whose keypoints come after those of the tracks."""
    offset = np.array([len(tracked[first]), len(tracked[second])], dtype=np.uint32)
    return far.pairs[first, second][0] + offset


def _write_pair(
    db: pycolmap.Database,
    first: int,
    second: int,
    matches: Matches,
    geometry: pycolmap.TwoViewGeometry,
) -> None:
    geometry.inlier_matches = matches
    db.write_matches(first, second, matches)
    db.write_two_view_geometry(first, second, geometry)


def _write_images(
    db: pycolmap.Database, names: Sequence[str], camera: pycolmap.Camera
) -> list[int]:
    """The ids of the images, which share one camera."""
    shared = db.read_camera(db.write_camera(camera))
    rig = pycolmap.Rig(rig_id=1)
    rig.add_ref_sensor(shared.sensor_id)
    rig_id = db.write_rig(rig)
    ids = []
    for name in names:
        image_id = db.write_image(pycolmap.Image(name=name, camera_id=shared.camera_id))
        image = db.read_image(image_id)
        frame = pycolmap.Frame(rig_id=rig_id)
        frame.add_data_id(image.data_id)
        image.frame_id = db.write_frame(frame)
        db.update_image(image)
        ids.append(image_id)
    return ids


def _pair_geometry(
    camera: pycolmap.Camera, tracked: Sequence[Keypoints], pair: tuple[int, int, Matches]
) -> pycolmap.TwoViewGeometry | None:
    """The geometry of two rows of tracked frames; None where their matches determine none."""
    first, second, matches = pair
    some = matches[:: max(1, len(matches) // GEOMETRY_MATCHES)]
    from_px, to_px = tracked[first].astype(float), tracked[second].astype(float)
    geometry = pycolmap.estimate_two_view_geometry(
        camera, from_px, camera, to_px, some, two_view_options()
    )
    return None if geometry.config in UNUSABLE else geometry
