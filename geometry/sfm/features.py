"""SIFT features and verified matches in a COLMAP database."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap

from geometry.arrays import FloatArray
from geometry.camera import Camera
from geometry.lens_calibration import LensName

MAX_FEATURES = 1500
"""Most SIFT features of an image."""
FIRST_OCTAVE = 0
"""First octave of SIFT: 0 is the image as it is."""
FINE_MAX_FEATURES = 4096
"""Most features of the second attempt."""
FINE_FIRST_OCTAVE = -1
"""First octave of the second attempt: -1 doubles the image."""
DEFAULT_FOCAL_FACTOR = 1.2
"""Focal length over the longest side where nothing is known, COLMAP's default."""
FISHEYE_FOCAL_FACTOR = 0.6
"""The same of a fisheye: 95 degrees along the longest side; chosen."""
MODELS: dict[LensName | None, str] = {
    None: "SIMPLE_RADIAL",
    "pinhole": "SIMPLE_PINHOLE",
    "radial": "RADIAL",
    "fisheye": "RADIAL_FISHEYE",
}
"""COLMAP's model of a lens that is estimated with the poses."""
EXHAUSTIVE_UP_TO = 60
"""Most images of which every pair is matched."""
SEED = 0
THREADS = 1
"""Of COLMAP: one, so that the same input gives the same result."""
CHUNK = 10
"""Images between two reports of progress."""
SEQUENTIAL_OCTAVES = 10
"""Number of step lengths between matched images; each is twice the one before."""
FEWEST_TRIALS = 20  # of RANSAC; its confidence asks for more where matches are poor


@dataclass(frozen=True, kw_only=True)
class MatchedPair:
    """The verified matches of two images.

    Attributes:
        first: Row of the first image.
        second: Row of the second image.
        pixels: (M, 2, 2) matched positions in COLMAP's px: match, image, (x, y).
    """

    first: int
    second: int
    pixels: FloatArray

    @property
    def displacement_px(self) -> float:
        """Median distance between matched positions, px."""
        return float(np.median(np.linalg.norm(self.pixels[:, 1] - self.pixels[:, 0], axis=1)))


def extract_features(
    database: Path,
    image_dir: Path,
    names: Sequence[str],
    camera: pycolmap.Camera,
    on_share: Callable[[float], None],
    *,
    fine: bool = False,
) -> list[int]:
    """Finds features in every image; all images share `camera`.

    Args:
        database: Written anew.
        image_dir: Folder of the images.
        names: File names in it.
        camera: What to start from.
        on_share: Called with the share of the images done.
        fine: More and smaller features, at four times the cost.

    Returns:
        The number of features of each image.
    """
    database.unlink(missing_ok=True)
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = camera.model_name
    reader.camera_params = ", ".join(repr(float(value)) for value in camera.params)
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = THREADS
    options.sift.max_num_features = FINE_MAX_FEATURES if fine else MAX_FEATURES
    options.sift.first_octave = FINE_FIRST_OCTAVE if fine else FIRST_OCTAVE
    for start in range(0, len(names), CHUNK):
        pycolmap.extract_features(
            database,
            image_dir,
            image_names=list(names[start : start + CHUNK]),
            camera_mode=pycolmap.CameraMode.SINGLE,
            reader_options=reader,
            extraction_options=options,
        )
        reader.existing_camera_id = 1
        on_share(min(1.0, (start + CHUNK) / len(names)))
    with pycolmap.Database.open(database) as db:
        stored = db.read_all_cameras()[0]
        stored.has_prior_focal_length = camera.has_prior_focal_length
        db.update_camera(stored)
        return [db.num_keypoints_for_image(i) for i in image_ids(db, names)]


def match_features(database: Path, *, sequential: bool) -> None:
    """Matches images 1, 2, 4, 8, ... steps apart, or every pair."""
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = THREADS
    verification = two_view_options()
    if not sequential:
        pycolmap.match_exhaustive(database, matching, verification_options=verification)
        return
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = SEQUENTIAL_OCTAVES
    pairing.quadratic_overlap = True
    pairing.num_threads = THREADS
    pycolmap.match_sequential(database, matching, pairing, verification_options=verification)


def two_view_options() -> pycolmap.TwoViewGeometryOptions:
    """How the geometry of a pair is estimated."""
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = SEED
    options.ransac.min_num_trials = FEWEST_TRIALS
    return options


def image_ids(db: pycolmap.Database, names: Sequence[str]) -> list[int]:
    """COLMAP's id of each image, in the order of `names`."""
    ids = {image.name: image.image_id for image in db.read_all_images()}
    return [ids[name] for name in names]


def read_pairs(database: Path, names: Sequence[str]) -> list[MatchedPair]:
    """Every pair with verified matches."""
    pairs = []
    with pycolmap.Database.open(database) as db:
        row_of = {image_id: row for row, image_id in enumerate(image_ids(db, names))}
        keypoints = {i: np.asarray(db.read_keypoints(i), dtype=float)[:, :2] for i in row_of}
        pair_ids, geometries = db.read_two_view_geometries()
        for pair_id, geometry in zip(pair_ids, geometries, strict=True):
            matches = np.asarray(geometry.inlier_matches, dtype=np.int64)
            first, second = pycolmap.pair_id_to_image_pair(pair_id)
            if len(matches) == 0:
                continue
            pixels = np.stack(
                [keypoints[first][matches[:, 0]], keypoints[second][matches[:, 1]]], axis=1
            )
            pairs.append(MatchedPair(first=row_of[first], second=row_of[second], pixels=pixels))
    return pairs


def starting_camera(
    width: int,
    height: int,
    camera: Camera | None,
    focal_prior_px: float | None,
    lens: LensName | None = None,
) -> pycolmap.Camera:
    """The camera to start from: given, from a focal prior, or a guess of the field of view."""
    if camera is not None:
        known = camera.to_colmap()
        known.has_prior_focal_length = True
        return known
    factor = FISHEYE_FOCAL_FACTOR if lens == "fisheye" else DEFAULT_FOCAL_FACTOR
    focal_px = focal_prior_px or factor * max(width, height)
    guess = pycolmap.Camera.create_from_model_name(1, MODELS[lens], focal_px, width, height)
    # No fundamental matrix holds for a fisheye; with a prior, COLMAP verifies by the essential one.
    guess.has_prior_focal_length = focal_prior_px is not None or lens == "fisheye"
    return guess
