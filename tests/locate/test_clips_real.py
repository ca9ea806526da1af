import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from detect.learning.clips import TrainingClip, clip_path, list_clips
from detect.registered.features import FEATURES, SMALL_PX
from geometry.errors import BadInputError
from geometry.pose_files import write_colmap_model
from geometry.trajectory import Trajectory
from locate.simulation import clips, make_clips, photo_set_clips
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.capture_degradation import degrade_capture
from locate.simulation.clips import draw_clip_scene, make_photo_clip
from locate.simulation.photo_scenes import make_photo_capture
from locate.simulation.photo_set import PhotoSet
from locate.simulation.photo_set_clips import make_photo_set_clip
from locate.simulation.scene import CameraBlock, PathBlock, PlumeSpec, Scene, VideoBlock

COUNT, SIDE_PX, RANGE_M = 9, (128, 96), 10.0


def textured(seed: int, shape: tuple[int, int] = (512, 512)) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2)
    return (128 + 45 * smooth / smooth.std()).clip(0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    folder = tmp_path_factory.mktemp("photos")
    for number in range(8):
        cv2.imwrite(str(folder / f"{number}.png"), textured(number))
    return tuple(sorted(folder.iterdir()))


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"CLIP_FRAMES": 11, "KEY_FRAMES": 2, "SIDE_PX": (128, 96)}.items():
        monkeypatch.setattr(clips, name, value)
    monkeypatch.setattr(clips, "FOCAL_PX", (110.0, 120.0))


@pytest.mark.usefixtures("small")
def test_a_clip_before_photos_repeats(photos: tuple[Path, ...]) -> None:
    one, again = (make_photo_clip(3, photos, plume=False, nuisances=["wind"]) for _ in range(2))
    assert one.inputs.shape == (2, len(FEATURES), 96, 128)
    assert np.isfinite(one.inputs).all()
    assert not one.displacements.any()
    np.testing.assert_array_equal(one.inputs, again.inputs)
    other = make_photo_clip(4, photos, plume=False)
    assert (other.inputs != one.inputs).any()


def test_scenes_of_photos_keep_the_camera_and_share_flows(photos: tuple[Path, ...]) -> None:
    scenes = [draw_clip_scene(seed, plume=True) for seed in (100, 101, 110)]
    captures = [make_photo_capture(scene, photos) for scene in scenes]
    assert captures[0].scene.path == scenes[0].path
    assert not captures[0].scene.objects
    assert captures[0].scene.plumes[0].source == scenes[0].plumes[0].source
    flows = [
        capture.scene.plumes[0].model_dump(exclude={"source", "amplitude_px"})
        for capture in captures
    ]
    assert flows[0] == flows[1] != flows[2]
    assert (
        len(
            {
                capture.billboards[0].photo
                for capture in (make_photo_capture(s, photos) for s in scenes)
            }
        )
        > 1
    )


def test_rough_takes_stride_wider_and_shake_more(photos: tuple[Path, ...]) -> None:
    captures = [make_photo_capture(draw_clip_scene(seed), photos) for seed in range(300, 330)]
    rough = [degrade_capture(capture) for capture in captures]
    assert [one.scene.path for one in rough] == [
        degrade_capture(capture).scene.path for capture in captures
    ]
    assert {one.scene.path.kind for one in rough} == {"approach", "handheld", "lawn_mower"}
    assert all(one.scene.path.jitter_m >= 0.02 for one in rough)
    rounds = [
        (one.scene.path.arc_deg, capture.scene.path.arc_deg)
        for one, capture in zip(rough, captures, strict=True)
        if one.scene.path.kind == "handheld"
    ]
    assert np.mean([a for a, _ in rounds]) > 1.5 * np.mean([b for _, b in rounds])
    assert all(
        one.scene.plumes == capture.scene.plumes
        for one, capture in zip(rough, captures, strict=True)
    )
    assert any(one.coding for one in rough)
    assert any(not one.shutter.is_instant for one in rough)


@pytest.mark.usefixtures("small")
def test_a_rough_clip_is_registered_worse(photos: tuple[Path, ...]) -> None:
    def sigma_px(clip: TrainingClip) -> float:
        channel = clip.inputs[:, FEATURES.index("log_sigma")].astype(float)
        return float(np.median(SMALL_PX * np.exp(channel)))

    pairs = [
        (make_photo_clip(seed, photos, plume=False, rough=rough) for rough in (False, True))
        for seed in (5, 6, 7)
    ]
    assert np.mean([sigma_px(rough) / sigma_px(calm) for calm, rough in pairs]) > 1.2


def posed_set(folder: Path) -> Path:
    """Photos of a wall of noise that faces the cameras, with its points."""
    camera = CameraBlock(width=256, height=192, focal_px=220.0)
    path = PathBlock(
        kind="lawn_mower", target=(0, 0, 0), height_m=RANGE_M, lanes=1, length_m=3.0, pitch_deg=89.9
    )
    trajectory = simulate_trajectory(
        Scene(camera=camera, path=path, video=VideoBlock(frames=COUNT))
    )
    ground = textured(9, (800, 800)).astype(np.float32)
    names = []
    (folder / "images").mkdir(parents=True)
    for i in range(COUNT):
        pixels = trajectory.camera.pixel_grid()
        rays = trajectory.camera.rays(pixels) @ trajectory.rotations[i]
        center = trajectory.centers_in_world[i]
        points = center + rays * (-center[2] / rays[..., 2:])
        places = (points[..., :2] * 22 + 400).astype(np.float32)
        photo = cv2.remap(ground, places, None, cv2.INTER_LINEAR)
        names.append(f"{i}.png")
        cv2.imwrite(str(folder / "images" / names[-1]), photo.astype(np.uint8))
    x, y = np.meshgrid(np.linspace(-6, 6, 15), np.linspace(-6, 6, 15))
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    write_colmap_model(trajectory, points, folder / "sparse", names)
    return folder


@pytest.fixture
def photo_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PhotoSet:
    monkeypatch.setattr(photo_set_clips, "SIDE_PX", SIDE_PX)
    return PhotoSet.load(posed_set(tmp_path / "set"))


def test_a_set_without_a_plume_is_a_negative(
    photo_set: PhotoSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(photo_set_clips, "PLUME_FREE_SHARE", 1.0)
    clip = make_photo_set_clip(photo_set, 1)
    assert clip.inputs.shape[1:] == (len(FEATURES), SIDE_PX[1], SIDE_PX[0])
    assert len(clip) >= 3 * photo_set_clips.WINDOWS
    assert clip.surface.all()
    assert not clip.displacements.any()
    assert clip.amplitude_px == 0


def test_a_plume_before_a_set_is_where_the_truth_says(
    photo_set: PhotoSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    def column(*_arguments: object) -> PlumeSpec:
        eye = photo_set.trajectory.centers_in_world[COUNT // 2]
        x, y, z = (eye + 0.4 * (np.median(photo_set.points_in_world, axis=0) - eye)).tolist()
        source = (x, y, z - 1)
        return PlumeSpec(
            kind="gaussian", source=source, radius_m=0.4, height_m=2.0, amplitude_px=1.0
        )

    monkeypatch.setattr(photo_set_clips, "PLUME_FREE_SHARE", 0.0)
    monkeypatch.setattr(photo_set_clips, "RANGE_M", (RANGE_M, RANGE_M + 1e-6))
    monkeypatch.setattr(photo_set_clips, "_draw_plume", column)
    clip = make_photo_set_clip(photo_set, 1)
    assert clip.amplitude_px == pytest.approx(1.0)
    w = clip.displacements.astype(float)
    seen = 0.1 * np.sinh(clip.inputs[:, :2].astype(float)).transpose(0, 2, 3, 1)
    there = np.linalg.norm(w, axis=-1) > 0.3
    assert there.any()
    assert np.corrcoef(seen[there].ravel(), w[there].ravel())[0, 1] > 0.5


def test_the_folder_of_a_run_is_a_photo_set(photo_set: PhotoSet, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    (folder / "images").rename(folder / "frames")
    (folder / "sfm").mkdir()
    (folder / "sparse").rename(folder / "sfm" / "model")
    loaded = PhotoSet.load(folder)
    assert [path.parent.name for path in loaded.paths] == ["frames"] * COUNT
    np.testing.assert_array_equal(loaded.points_in_world, photo_set.points_in_world)


def test_a_set_without_points_is_refused(photo_set: PhotoSet) -> None:
    with pytest.raises(BadInputError, match="without sparse points"):
        make_photo_set_clip(replace(photo_set, points_in_world=np.empty((0, 3))), 1)


def test_the_world_of_a_set_gets_the_size_of_a_scene(photo_set: PhotoSet) -> None:
    scaled = photo_set_clips._scale_set(photo_set, np.random.default_rng(0))
    depth = scaled.trajectory.world_to_cam(COUNT // 2, scaled.points_in_world)[:, 2]
    low, high = photo_set_clips.RANGE_M
    assert low <= np.median(depth) <= high
    one, other = (
        s.trajectory.project(0, s.points_in_world) for s in (photo_set, scaled)
    )  # the photos stay as they are
    np.testing.assert_allclose(one, other, atol=1e-6)


@pytest.mark.usefixtures("small")
def test_the_command_keeps_what_stands(
    photos: tuple[Path, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []

    def make(seed: int, _photos: object, **_options: object) -> TrainingClip:
        made.append(seed)
        nothing = np.zeros((1, len(FEATURES), 8, 8), np.float16)
        flat = np.zeros((1, 8, 8, 2), np.float16)
        surface = np.ones((1, 8, 8), bool)
        return TrainingClip(inputs=nothing, displacements=flat, surface=surface, amplitude_px=0.0)

    monkeypatch.setattr(make_clips, "make_photo_clip", make)
    for _ in range(2):
        make_clips.write_photo_clips(photos, range(5, 8), tmp_path)
    assert made == [5, 6, 7]
    assert list_clips(tmp_path) == [clip_path(tmp_path, seed) for seed in (5, 6, 7)]
    lines = [json.loads(line) for line in (tmp_path / "lessons.jsonl").read_text().splitlines()]
    assert [line["seed"] for line in lines] == [5, 6, 7]
    assert all(line["kind"] == "photos" for line in lines)


def test_a_folder_without_poses_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no poses"):
        make_clips.write_photo_set_clips(tmp_path, range(1), tmp_path / "lessons")


def test_disturbed_poses_are_off_by_what_was_asked() -> None:
    trajectory = simulate_trajectory(Scene(video=VideoBlock(frames=400)))
    told = clips.perturb_poses(trajectory, np.random.default_rng(0), 0.2)
    assert isinstance(told, Trajectory)
    turns = np.einsum("nij,nkj->nik", told.rotations, trajectory.rotations)
    angles = np.degrees(np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert np.sqrt((angles**2).mean() / 3) == pytest.approx(0.2, rel=0.1)
