"""What each source makes of its data, against simulated truth; the frame on the Earth."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.georeference import Georeference, HeightDatum, fit_similarity
from geometry.georeference.board import BoardSighting, find_board, marker_board, scale_from_board
from geometry.georeference.fixes import MAX_FIXES, positions_of_cameras
from geometry.georeference.gravity import up_from_gimbal, up_from_ground, up_from_vectors
from geometry.georeference.lengths import point_from_pixels, scale_from_distance, scale_from_height
from geometry.similarity import Similarity
from tests.geometry.surveys import arc, looking_down, strips

DULUTH = Georeference(
    lat_deg=46.8426, lon_deg=-91.9946, height_m=198.0, datum=HeightDatum.ELLIPSOID
)
TILTED = Similarity(
    scale=0.25,
    rotation=Rotation.from_euler("xyz", [8, -5, 130], degrees=True).as_matrix(),
    translation=np.array([1.0, -4.0, 2.0]),
)
UP_IN_SCENE = TILTED.rotation @ [0.0, 0.0, 1.0]


def degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


def test_local_and_geodetic_are_inverse_over_kilometres() -> None:
    points = np.random.default_rng(1).uniform(-5000, 5000, size=(50, 3))
    np.testing.assert_allclose(DULUTH.to_enu(DULUTH.lat_lon_height(points)), points, atol=1e-6)


def test_one_metre_east_and_north_on_the_ellipsoid() -> None:
    """Radii of curvature of WGS84, a derivation of its own."""
    lat, lon, height = DULUTH.lat_lon_height([[100.0, -50.0, 2.0]])[0]
    phi, a, e2 = np.radians(DULUTH.lat_deg), 6378137.0, 0.00669437999014
    w = 1 - e2 * np.sin(phi) ** 2
    normal, meridian = a / np.sqrt(w) + 198, a * (1 - e2) / w**1.5 + 198
    east = np.radians(lon - DULUTH.lon_deg) * normal * np.cos(phi)
    north = np.radians(lat - DULUTH.lat_deg) * meridian
    np.testing.assert_allclose([east, north, height - 198], [100, -50, 2], atol=0.005)


def test_heights_are_never_mixed_without_a_geoid() -> None:
    point = np.zeros((1, 3))
    assert DULUTH.heights_in(HeightDatum.ELLIPSOID, point) == pytest.approx([198.0])
    unnamed = Georeference.from_origin(
        [46.8, -92.0, 198.0], HeightDatum.MEAN_SEA_LEVEL, "first fix"
    )
    assert unnamed.heights_in(HeightDatum.ELLIPSOID, point) is None
    converted = DULUTH.heights_in(HeightDatum.EGM96, point)
    # With a geoid grid installed: it lies about 30 m below the ellipsoid at Duluth.
    assert converted is None or converted[0] == pytest.approx(198 + 30, abs=3)


def test_a_georeference_survives_its_block() -> None:
    assert Georeference.from_dict(DULUTH.to_dict()) == DULUTH
    with pytest.raises(BadInputError, match="'sea' is not a valid HeightDatum"):
        Georeference.from_dict(DULUTH.to_dict() | {"height_datum": "sea"})
    with pytest.raises(BadInputError, match="not on the Earth"):
        Georeference.from_origin([-92.0, 46.8, 1.0], HeightDatum.UNKNOWN, "swapped")


@pytest.mark.parametrize("pitch_deg", [-90.0, -60.0, 0.0])
def test_gimbal_angles_give_up(pitch_deg: float) -> None:
    """Cameras aimed by yaw, pitch and roll in the north-east-down sense."""
    rng = np.random.default_rng(2)
    yaws, rolls = rng.uniform(-180, 180, size=20), rng.uniform(-20, 20, size=20)
    ned_from_body = Rotation.from_euler(
        "ZYX", np.stack([yaws, np.full(20, pitch_deg), rolls], axis=1), degrees=True
    ).as_matrix()
    body_from_cam = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    enu_from_ned = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    cameras = looking_down(strips(20))
    rotations = (enu_from_ned @ ned_from_body @ body_from_cam).swapaxes(1, 2)
    cameras = type(cameras)(**vars(cameras) | {"rotations": rotations}).transformed(TILTED)
    up = up_from_gimbal(cameras, np.full(20, pitch_deg), rolls)
    assert degrees_between(up.up_in_source, UP_IN_SCENE) < 1e-4
    assert np.degrees(up.sigma_rad) == pytest.approx(0.5, rel=0.01)


def test_up_from_accelerometers_shrugs_off_manoeuvres() -> None:
    rng = np.random.default_rng(3)
    cameras = looking_down(strips(80)).transformed(TILTED)
    ups = np.tile([0.0, 0.0, -9.81], (80, 1)) + rng.normal(size=(80, 3)) * 0.3
    ups[:12] += [6.0, 0.0, 0.0]
    ups[40] = np.nan
    up = up_from_vectors(cameras, ups, shared_sigma_deg=0.1)
    error_deg = degrees_between(up.up_in_source, UP_IN_SCENE)
    assert error_deg < 3 * np.degrees(up.sigma_rad)
    assert np.degrees(up.sigma_rad) < 0.6
    with pytest.raises(BadInputError, match="no frame"):
        up_from_vectors(cameras, np.full((80, 3), np.nan))


def test_the_ground_gives_up_and_with_a_height_the_scale() -> None:
    rng = np.random.default_rng(4)
    ground = np.column_stack([rng.uniform(-20, 110, (600, 2)), rng.normal(size=600) * 0.1])
    houses = rng.uniform([0, 0, 0], [90, 50, 12], size=(200, 3))
    level = Similarity(
        scale=0.25,
        rotation=Rotation.from_euler("xyz", [3, -2, 130], degrees=True).as_matrix(),
        translation=np.array([1.0, -4.0, 2.0]),
    )
    path = strips(30)
    cameras = looking_down(path).transformed(level)
    points = level(np.concatenate([ground, houses]))
    up = up_from_ground(cameras, points)
    assert degrees_between(up.up_in_source, level.rotation @ [0, 0, 1.0]) < 0.4
    scale = scale_from_height(cameras, points, path[:, 2], sigma_m=0.5)
    assert scale.metres_per_unit == pytest.approx(4.0, rel=0.01)
    assert 0.5 / 45 < scale.sigma_log < 0.03
    with pytest.raises(BadInputError, match="ground plane"):
        up_from_ground(cameras, rng.normal(size=(400, 3)) * 30)


def test_a_clicked_distance_gives_the_scale() -> None:
    rng = np.random.default_rng(5)
    ends = np.array([[20.0, 20.0, 0.0], [32.0, 25.0, 1.0]])
    cameras = looking_down(arc(12) + np.array([25, 0, 30])).transformed(TILTED)
    found = []
    for end in TILTED(ends):
        rows = np.arange(12)
        pixels = np.array([cameras.project(i, end) for i in rows]) + rng.normal(size=(12, 2))
        found.append(point_from_pixels(cameras, rows, pixels, sigma_px=1.0))
    (first, first_covariance), (second, second_covariance) = found
    errors = np.array([first, second]) - TILTED(ends)
    covariances = np.array([first_covariance, second_covariance])
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors) / 3
    assert (nees < 4).all()
    scale = scale_from_distance(
        first,
        second,
        float(np.linalg.norm(ends[1] - ends[0])),
        sigma_m=0.02,
        covariances=(first_covariance, second_covariance),
    )
    assert abs(np.log(scale.metres_per_unit / 4.0)) < 3 * scale.sigma_log < 0.03
    with pytest.raises(BadInputError, match="two different points"):
        scale_from_distance(first, first, 3.0, sigma_m=0.1)
    with pytest.raises(BadInputError, match="two frames"):
        point_from_pixels(cameras, np.array([0]), np.zeros((1, 2)), sigma_px=1.0)


@pytest.mark.parametrize("dictionary", ["4X4_50", "APRILTAG_36h11"])
def test_a_board_in_the_frames_gives_the_scale(dictionary: str) -> None:
    """A board of 2 by 2 markers of 0.2 m lies on the ground; its pictures are drawn by warping."""
    board = marker_board(dictionary, columns=2, rows=2, size_m=0.2, gap_m=0.05)
    print_px = 500
    printed = board.generateImage((print_px, print_px), marginSize=0)
    side_m = 0.45
    centers = np.array([[x, y, 1.6] for x in (-0.3, 0.0, 0.3) for y in (-0.2, 0.2)])
    cameras = looking_down(centers, tilt=Rotation.from_euler("xz", [12, 20], degrees=True))
    images = [picture(printed, side_m, cameras.camera, cameras, row) for row in range(6)]
    scene = cameras.transformed(TILTED)
    sightings = find_board(images, board)
    assert len(sightings) == 6
    scale = scale_from_board(scene, sightings)
    assert abs(np.log(scale.metres_per_unit / 4.0)) < 3 * scale.sigma_log
    assert scale.sigma_log < 0.01
    with pytest.raises(BadInputError, match="at least 2"):
        scale_from_board(scene, sightings[:1])
    moves_px = np.array([[-60, 45], [60, 0], [0, -45], [-60, -45], [60, 45], [0, 90]])
    moved = [replace(s, pixels=s.pixels + moves_px[s.row]) for s in sightings]
    with pytest.raises(BadInputError, match=r"marker board: its corners are .* px \(median\)"):
        scale_from_board(scene, moved)
    at_rest = [
        BoardSighting(row=0, **{k: v for k, v in vars(s).items() if k != "row"})
        for s in (sightings[0], sightings[0])
    ]
    with pytest.raises(BadInputError, match="one place"):
        scale_from_board(scene, at_rest)


def picture(
    printed: np.ndarray, side_m: float, camera: Camera, cameras: object, row: int
) -> np.ndarray:
    """The board, lying at the origin with its top to the north, as one camera sees it."""
    corners_m = side_m * np.array([[-0.5, 0.5, 0], [0.5, 0.5, 0], [0.5, -0.5, 0], [-0.5, -0.5, 0]])
    n = len(printed)
    on_print = np.array([[0, 0], [n, 0], [n, n], [0, n]], dtype=np.float32) - np.float32(0.5)
    seen = cameras.project(row, corners_m).astype(np.float32)
    view = cv2.getPerspectiveTransform(on_print, seen)
    size = (camera.width, camera.height)
    return cv2.warpPerspective(printed, view, size, flags=cv2.INTER_AREA, borderValue=200)


def test_an_unknown_dictionary_is_refused() -> None:
    with pytest.raises(BadInputError, match="no marker dictionary"):
        marker_board("5X9", size_m=0.1)


def test_stale_and_missing_fixes_are_left_out_and_many_are_thinned() -> None:
    path = strips(500)
    cameras = looking_down(path)
    fixes = path.copy()
    fixes[10] = fixes[9]
    fixes[20] = np.nan
    few = positions_of_cameras(cameras.take(np.arange(50)), fixes[:50], [1.0, 1.0, 2.0])
    assert len(few) == 48
    assert few.times_s is not None
    assert 10 not in few.times_s
    assert 20 not in few.times_s
    many = positions_of_cameras(cameras, fixes, [1.0, 1.0, 2.0])
    assert len(many) == MAX_FIXES
    assert fit_similarity([many]).target_from_source.scale == pytest.approx(1.0)
