"""Structure from motion on small rendered scenes: what works, and every failure by its name."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from geometry.camera import Camera
from geometry.errors import BadInputError, RegistrationError, RegistrationFailure
from geometry.lens_calibration import LensName
from geometry.sfm import Reconstruction, checks, features, mapping, reconstruct, tracks, zooms
from geometry.sfm.job import STAGES
from geometry.sfm.summary import triangulation_angles_deg
from geometry.similarity import align_points

WIDTH, HEIGHT, FOCAL = 480, 360, 420.0
K = np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])
TEXTURE_PX = 700


def texture(seed: int) -> np.ndarray:
    """A photo-like texture: detail at every scale."""
    random = np.random.default_rng(seed)
    total = np.zeros((TEXTURE_PX, TEXTURE_PX), np.float32)
    for size in (8, 20, 50, 120, 300):
        coarse = random.normal(size=(size, size)).astype(np.float32)
        total += cv2.resize(coarse, (TEXTURE_PX, TEXTURE_PX), interpolation=cv2.INTER_CUBIC)
    return cv2.normalize(total, None, 10, 245, cv2.NORM_MINMAX).astype(np.uint8)


@dataclass(frozen=True)
class Card:
    """A textured rectangle: corner, its two sides, texture; world units."""

    corner: tuple[float, float, float]
    right: tuple[float, float, float]
    down: tuple[float, float, float]
    seed: int


ROOM = (
    Card((-9, 6, 7), (18, 0, 0), (0, 0, -7), 1),
    Card((-9, 6, 0), (18, 0, 0), (0, -12, 0), 2),
    Card((-2.5, 2, 2.2), (1.8, 0.4, 0), (0, 0, -2.2), 3),
    Card((0.8, 1, 1.6), (1.6, -0.3, 0), (0, 0, -1.6), 4),
)
FLOOR = (Card((-12, 12, 0), (24, 0, 0), (0, -24, 0), 5),)


def look_at(eye: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return rotation, -rotation @ eye


def render(cards: tuple[Card, ...], rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    image = np.full((HEIGHT, WIDTH), 128, np.uint8)
    for card in cards:
        sides = np.array([card.right, card.down]).T / TEXTURE_PX
        plane = np.column_stack([sides, np.array(card.corner)])
        homography = K @ (rotation @ plane + np.outer(translation, [0, 0, 1]))
        skin = texture(card.seed)
        warped = cv2.warpPerspective(skin, homography, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)
        inside = cv2.warpPerspective(np.full_like(skin, 255), homography, (WIDTH, HEIGHT))
        image[inside > 127] = warped[inside > 127]
    return image


def orbit(count: int, arc_deg: float = 40.0) -> list[tuple[np.ndarray, np.ndarray]]:
    angles = np.radians(np.linspace(-arc_deg / 2, arc_deg / 2, count))
    eyes = np.stack([8 * np.sin(angles), 2 - 8 * np.cos(angles), np.full(count, 2.0)], axis=1)
    return [look_at(eye, np.array([0.0, 2.0, 1.5])) for eye in eyes]


def write(folder: Path, images: list[np.ndarray]) -> list[str]:
    random = np.random.default_rng(0)
    folder.mkdir()
    names = [f"{i:06d}.png" for i in range(len(images))]
    for name, image in zip(names, images, strict=True):
        noisy = image + random.normal(scale=1.0, size=image.shape)
        cv2.imwrite(str(folder / name), np.clip(noisy, 0, 255).astype(np.uint8))
    return names


def run(tmp_path: Path, images: list[np.ndarray], **options: object) -> Reconstruction:
    names = write(tmp_path / "images", images)
    indices = np.arange(len(names))
    return reconstruct(
        tmp_path / "images", names, indices, indices / 10, workdir=tmp_path / "sfm", **options
    )


def failure_of(tmp_path: Path, images: list[np.ndarray], **options: object) -> RegistrationError:
    with pytest.raises(RegistrationError) as caught:
        run(tmp_path, images, **options)
    assert "\n" not in str(caught.value)
    return caught.value


@pytest.fixture(scope="module")
def room_poses() -> list[tuple[np.ndarray, np.ndarray]]:
    return orbit(10)


@pytest.fixture(scope="module")
def room_images(room_poses: list[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    return [render(ROOM, *pose) for pose in room_poses]


def true_camera() -> Camera:
    return Camera.pinhole(WIDTH, HEIGHT, FOCAL)


def rotation_errors_deg(found: Reconstruction, poses: list, rows: np.ndarray) -> np.ndarray:
    truth = np.array([poses[i][0] for i in rows])
    world = Rotation.from_matrix(np.swapaxes(truth, 1, 2) @ found.trajectory.rotations).mean()
    left = found.trajectory.rotations @ np.swapaxes(truth @ world.as_matrix(), 1, 2)
    return np.degrees(Rotation.from_matrix(left).magnitude())


def test_room_with_free_focal(
    tmp_path: Path, room_images: list[np.ndarray], room_poses: list
) -> None:
    stages: dict[str, float] = {}
    found = run(tmp_path, room_images, progress=stages.__setitem__)
    eyes = np.array([-r.T @ t for r, t in room_poses])
    centers = found.trajectory.centers_in_world
    errors = np.linalg.norm(align_points(centers, eyes)(centers) - eyes, axis=1)
    assert len(found.trajectory) == 10
    assert found.report["focal_px"] == pytest.approx(FOCAL, rel=0.02)
    assert found.report["focal_sigma_px"] < 0.005 * FOCAL
    assert np.median(errors) < 0.02
    assert np.median(rotation_errors_deg(found, room_poses, np.arange(10))) < 0.1
    assert list(stages) == list(STAGES)
    assert stages["matching features"] == pytest.approx(0.45)
    assert 0.6 < stages["mapping"] < 0.9
    assert stages["adjusting"] == 1


def test_a_camera_that_only_comes_nearer_hardly_shows_its_focal_length(tmp_path: Path) -> None:
    eyes = [np.array([0.03 * np.sin(k), -6 + 0.25 * k, 2.0]) for k in range(10)]
    images = [render(ROOM, *look_at(eye, np.array([0.0, 3.0, 1.7]))) for eye in eyes]
    found = run(tmp_path, images)
    sigma_px = found.report["focal_sigma_px"]
    assert sigma_px > 0.01 * FOCAL
    assert abs(found.report["focal_px"] - FOCAL) < 4 * sigma_px


def test_a_given_focal_length_has_no_sigma(tmp_path: Path, room_images: list[np.ndarray]) -> None:
    found = run(tmp_path, room_images, camera=true_camera())
    assert found.report["focal_sigma_px"] is None


FISHEYE = Camera(
    model="OPENCV_FISHEYE",
    width=WIDTH,
    height=HEIGHT,
    params=(300.0, 300.0, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, 0.02, 0.0, 0.0, 0.0),
)


def seen_by_fisheye(image: np.ndarray) -> np.ndarray:
    """What a fisheye of 92 degrees sees where the pinhole sees the middle of it."""
    place = true_camera().project(FISHEYE.rays(FISHEYE.pixel_grid())).astype(np.float32)
    return cv2.remap(image, place, None, cv2.INTER_LINEAR, borderValue=128)


@pytest.mark.parametrize(
    ("lens", "model"),
    [("pinhole", "SIMPLE_PINHOLE"), ("radial", "RADIAL"), ("fisheye", "RADIAL_FISHEYE")],
)
def test_the_lens_that_was_asked_for_is_estimated(
    tmp_path: Path, room_images: list[np.ndarray], room_poses: list, lens: LensName, model: str
) -> None:
    images = [seen_by_fisheye(image) for image in room_images] if lens == "fisheye" else room_images
    found = run(tmp_path, images, lens=lens)
    camera = found.trajectory.camera
    assert camera.model == model
    assert ("fisheye" in (found.report["tracks_lost"] or "")) == (lens == "fisheye")
    assert camera.focal_px == pytest.approx(300 if lens == "fisheye" else FOCAL, rel=0.03)
    assert np.median(rotation_errors_deg(found, room_poses, np.arange(10))) < 0.2


def zoomed(image: np.ndarray, factor: float) -> np.ndarray:
    """As an optical zoom in on the middle shows it."""
    middle = np.array([WIDTH - 1, HEIGHT - 1]) / 2
    matrix = np.column_stack([factor * np.eye(2), (1 - factor) * middle])
    return cv2.warpAffine(image, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)


def test_photos_of_two_zooms_that_do_not_say_so_are_refused(
    tmp_path: Path, room_images: list[np.ndarray]
) -> None:
    images = [*room_images[:6], *(zoomed(image, 1.4) for image in room_images[6:])]
    error = failure_of(tmp_path, images, ordered=False)
    assert error.failure is RegistrationFailure.SEVERAL_ZOOMS
    assert "the frames are of 2 zooms: 6 of" in str(error)
    assert "4 of" in str(error)
    assert "(000006.png ...)" in str(error)


@pytest.mark.parametrize(
    ("focal_px", "sizes"),
    [
        (np.full(12, 500.0), [12]),
        (np.r_[np.full(8, 500.0), np.full(4, 700.0)], [8, 4]),
        (np.r_[np.full(4, 500.0), np.full(8, 700.0), np.full(5, 900.0)], [8, 5, 4]),
        (np.r_[np.full(11, 500.0), 900.0, 300.0], [13]),
        (np.linspace(400, 900, 20), [20]),
        (np.r_[np.linspace(450, 550, 10), np.linspace(610, 700, 10)], [20]),
        (np.r_[np.full(6, 500.0), np.full(6, 530.0)], [12]),
    ],
    ids=["one", "two", "three", "outliers", "scatter", "wide gap", "focus"],
)
def test_zooms_are_told_where_they_are_clear(focal_px: np.ndarray, sizes: list[int]) -> None:
    order = np.random.default_rng(0).permutation(len(focal_px))
    groups = zooms.group_zooms(focal_px[order])
    assert [len(rows) for rows in groups] == sizes
    for rows in groups if len(groups) > 1 else ():
        assert np.ptp(focal_px[order][rows]) == 0


def test_a_dense_recording_is_tied_together_by_tracks(tmp_path: Path) -> None:
    """Neighbours then agree to a hundredth of a degree."""
    poses = orbit(18, arc_deg=20.0)
    found = run(tmp_path, [render(ROOM, *pose) for pose in poses], camera=true_camera())
    truth = np.array([rotation for rotation, _ in poses])
    steps = found.trajectory.rotations[1:] @ np.swapaxes(found.trajectory.rotations[:-1], 1, 2)
    true_steps = truth[1:] @ np.swapaxes(truth[:-1], 1, 2)
    off = Rotation.from_matrix(steps @ np.swapaxes(true_steps, 1, 2)).magnitude()
    assert len(found.names) == 18
    assert found.report["tied_by"] == "tracks"
    assert np.degrees(np.median(off)) < 0.02


def test_threads_beside_each_other_change_nothing(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    images = [render(ROOM, *pose) for pose in orbit(18, arc_deg=20.0)]
    one = run(tmp_path / "one", images, camera=true_camera())
    two = run(tmp_path / "two", images, camera=true_camera(), jobs=2)
    assert one.report["tied_by"] == "tracks"
    assert one.report == two.report
    np.testing.assert_array_equal(one.trajectory.translations, two.trajectory.translations)
    np.testing.assert_array_equal(one.points_in_world, two.points_in_world)


def test_where_tracks_break_sift_matches_are_used(
    tmp_path: Path, room_images: list[np.ndarray]
) -> None:
    """Two ends of a path filmed by turns: neighbours share too little."""
    order = [0, 6, 1, 7, 2, 8]
    found = run(tmp_path, [room_images[i] for i in order], camera=true_camera(), ordered=False)
    assert found.report["tied_by"] == "SIFT"
    assert "key frames 0 and 1 share" in found.report["tracks_lost"]
    assert len(found.names) == 6


def test_tracks_that_do_not_give_every_pose_are_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two frames whose tracks are lost on the way to COLMAP."""
    images = [render(ROOM, *pose) for pose in orbit(8, arc_deg=16.0)]
    right = tracks.follow_features

    def lose_two(read: Iterable[np.ndarray]) -> list[tracks.TrackedFrame]:
        frames = right(read)
        nothing = tracks.TrackedFrame(ids=np.zeros(0, np.int64), pixels=np.zeros((0, 2)))
        return [*frames[:-2], nothing, nothing]

    monkeypatch.setattr(tracks, "follow_features", lose_two)
    found = run(tmp_path, images, camera=true_camera())
    assert found.report["tied_by"] == "SIFT"
    assert found.report["tracks_lost"] == "6 of 8 frames get a pose"
    assert len(found.names) == 8


def test_room_is_put_into_a_scene_frame(tmp_path: Path, room_images: list[np.ndarray]) -> None:
    found = run(tmp_path, room_images, camera=true_camera())
    trajectory, points = found.trajectory, found.points_in_world
    centers = trajectory.centers_in_world
    seen = [
        np.linalg.norm(points[v] - c, axis=1) for c, v in zip(centers, found.visible, strict=True)
    ]
    up_in_cam = trajectory.rotations[:, :, 2].mean(axis=0)
    true_up = np.array([r[:, 2] for r, _ in orbit(10)]).mean(axis=0)
    tilt_deg = np.degrees(np.arccos(up_in_cam @ true_up / np.linalg.norm(up_in_cam)))
    assert trajectory.camera == true_camera()
    assert not trajectory.metric
    assert not trajectory.gravity
    assert np.median(np.concatenate(seen)) == pytest.approx(10.0, rel=1e-6)
    np.testing.assert_allclose(np.median(points, axis=0), 0, atol=0.5)
    assert tilt_deg < 2


def test_result_survives_its_files_and_nothing_is_printed(
    tmp_path: Path, room_images: list[np.ndarray], capfd: pytest.CaptureFixture[str]
) -> None:
    pycolmap.logging.minloglevel = 0  # what pycolmap.bundle_adjustment leaves behind
    found = run(tmp_path, room_images[:7], camera=true_camera())
    assert capfd.readouterr() == ("", "")
    found.save(tmp_path / "saved")
    loaded = Reconstruction.load(tmp_path / "saved")
    model = pycolmap.Reconstruction(tmp_path / "sfm" / "model")
    image = model.find_image_with_name(found.names[3])
    assert loaded.names == found.names
    assert loaded.report == found.report
    np.testing.assert_array_equal(loaded.points_in_world, found.points_in_world)
    for a, b in zip(loaded.visible, found.visible, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_allclose(
        image.projection_center(), found.trajectory.centers_in_world[3], atol=1e-9
    )
    for i, rows in enumerate(found.visible):
        pixels = found.trajectory.project(i, found.points_in_world[rows])
        assert (pixels > -5).all()
        assert (pixels < [WIDTH + 5, HEIGHT + 5]).all()


def test_four_frames_report_what_is_not_known_as_none_and_one_rising_bar(
    tmp_path: Path, room_images: list[np.ndarray]
) -> None:
    told: list[tuple[str, float]] = []
    found = run(
        tmp_path,
        room_images[:4],
        camera=true_camera(),
        progress=lambda stage, fraction: told.append((stage, fraction)),
    )
    found.save(tmp_path / "saved")
    fractions = [fraction for _, fraction in told]
    assert found.report["roughness"] is None
    assert "NaN" not in (tmp_path / "saved" / "report.json").read_text()
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert 0 < fractions[0] <= 0.25
    assert {stage for stage, _ in told} == set(STAGES)


def test_flat_scene_is_fine(tmp_path: Path) -> None:
    eyes = [np.array([0.35 * i, 0.1 * i * (-1) ** (i // 4), 7.0]) for i in range(9)]
    down = np.diag([1.0, -1.0, -1.0])
    poses = [(down, -down @ eye) for eye in eyes]
    found = run(tmp_path, [render(FLOOR, *pose) for pose in poses], camera=true_camera())
    centers = found.trajectory.centers_in_world
    errors = np.linalg.norm(align_points(centers, np.array(eyes))(centers) - eyes, axis=1)
    assert np.median(errors) < 0.03


def test_too_few_frames(tmp_path: Path, room_images: list[np.ndarray]) -> None:
    error = failure_of(tmp_path, room_images[:2])
    assert error.failure is RegistrationFailure.TOO_FEW_FRAMES


def test_blank_images_lack_texture(tmp_path: Path) -> None:
    error = failure_of(tmp_path, [np.full((HEIGHT, WIDTH), 90 + i, np.uint8) for i in range(5)])
    assert error.failure is RegistrationFailure.LOW_TEXTURE


def test_static_camera(tmp_path: Path, room_images: list[np.ndarray]) -> None:
    error = failure_of(tmp_path, [room_images[5]] * 8)
    assert error.failure is RegistrationFailure.STATIC_CAMERA


@pytest.mark.parametrize("known_focal", [True, False])
def test_pure_rotation(tmp_path: Path, known_focal: bool) -> None:
    eye = np.array([0.0, -6.0, 2.0])
    first, _ = look_at(eye, np.array([0.0, 2.0, 1.5]))
    turns = [Rotation.from_euler("yx", [3.0 * i - 10, 0.5 * i], degrees=True) for i in range(8)]
    poses = [(turn.as_matrix() @ first, -turn.as_matrix() @ first @ eye) for turn in turns]
    camera = true_camera() if known_focal else None
    error = failure_of(tmp_path, [render(ROOM, *pose) for pose in poses], camera=camera)
    assert error.failure is RegistrationFailure.PURE_ROTATION


def test_two_scenes_in_one_recording(tmp_path: Path, room_images: list[np.ndarray]) -> None:
    other = tuple(Card(c.corner, c.right, c.down, c.seed + 50) for c in ROOM)
    images = room_images[:6] + [render(other, *pose) for pose in orbit(10)[:6]]
    error = failure_of(tmp_path, images)
    assert error.failure is RegistrationFailure.SPLIT_MODELS


def test_focal_length_that_contradicts_the_metadata(
    tmp_path: Path, room_images: list[np.ndarray]
) -> None:
    error = failure_of(tmp_path, room_images, focal_prior_px=2 * FOCAL)
    assert error.failure is RegistrationFailure.FOCAL_DIVERGED
    assert "--focal" in str(error)


def bent(models: list[pycolmap.Reconstruction], turn_deg: float) -> list[pycolmap.Reconstruction]:
    """Moves and turns the second half of the cameras, as global mapping has been seen to do."""
    for image_id in sorted(models[0].reg_image_ids())[5:]:
        image = models[0].image(image_id)
        turn = pycolmap.Rigid3d(
            pycolmap.Rotation3d(Rotation.from_euler("y", turn_deg, degrees=True).as_matrix()),
            np.array([0.5, 0, 0.5]),
        )
        image.frame.rig_from_world = turn * image.cam_from_world()
    return models


def test_a_model_that_kept_no_point_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    empty = {0: pycolmap.Reconstruction()}
    monkeypatch.setattr(pycolmap, "incremental_mapping", lambda *_, **__: empty)
    database = tmp_path / "database.db"
    found = mapping.map_incrementally(database, tmp_path, tmp_path / "out", refine_camera=True)
    assert found == []


def test_wrong_global_poses_are_caught(
    tmp_path: Path, room_images: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    right = mapping.map_globally
    monkeypatch.setattr(mapping, "map_globally", lambda *a, **k: bent(right(*a, **k), 12))
    found = run(tmp_path, room_images, camera=true_camera())
    assert found.report["method"] == "incremental"
    assert np.median(rotation_errors_deg(found, orbit(10), np.arange(10))) < 0.1


def test_poses_nobody_agrees_on_are_refused(
    tmp_path: Path, room_images: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, turn in (("map_globally", 12), ("map_incrementally", -12)):
        right = getattr(mapping, name)
        wrong = lambda *a, r=right, t=turn, **k: bent(r(*a, **k), t)  # noqa: E731
        monkeypatch.setattr(mapping, name, wrong)
    error = failure_of(tmp_path, room_images, camera=true_camera())
    assert error.failure is RegistrationFailure.IMPLAUSIBLE_POSES


def test_what_colmap_cannot_write_is_an_error_of_the_system(
    tmp_path: Path, room_images: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise RuntimeError("SQLite error: database or\n disk is full")

    monkeypatch.setattr(features, "read_pairs", fails)
    with pytest.raises(OSError, match="database or disk is full") as raised:
        run(tmp_path, room_images[:3])
    assert raised.value.filename.endswith("database.db")


def test_jagged_path_is_refused() -> None:
    report = {"points_per_image": 500, "triangulation_angle_deg": 5, "roughness": 1.7}
    with pytest.raises(RegistrationError) as caught:
        checks.check_quality(report, ordered=True)
    assert caught.value.failure is RegistrationFailure.IMPLAUSIBLE_POSES
    checks.check_quality(report, ordered=False)


def test_roughness_tells_a_path_from_a_scatter() -> None:
    random = np.random.default_rng(0)
    line = np.cumsum(np.ones((60, 3)), axis=0) + random.normal(scale=0.05, size=(60, 3))
    assert checks.path_roughness(line, np.arange(60)) < 0.3
    assert checks.path_roughness(random.normal(size=(60, 3)), np.arange(60)) > checks.MAX_ROUGHNESS


def test_camera_of_another_size_is_refused(tmp_path: Path, room_images: list[np.ndarray]) -> None:
    with pytest.raises(BadInputError, match="640x480"):
        run(tmp_path, room_images[:3], camera=Camera.pinhole(640, 480, 500))


def test_points_are_seen_under_the_widest_angle_between_two_rays() -> None:
    rng = np.random.default_rng(0)
    centers, points = rng.normal(size=(6, 3)), rng.normal((0, 0, 9), size=(40, 3))
    visible = tuple(np.flatnonzero(rng.random(40) < 0.5) for _ in centers)
    expected = np.zeros(40)
    for row, point in enumerate(points):
        rays = [point - c for c, v in zip(centers, visible, strict=True) if row in v]
        for a, b in combinations(rays, 2):
            cosine = a @ b / np.linalg.norm(a) / np.linalg.norm(b)
            expected[row] = max(expected[row], np.degrees(np.arccos(cosine)))
    found = triangulation_angles_deg(centers, points, visible)
    np.testing.assert_allclose(found, expected, atol=1e-6)
