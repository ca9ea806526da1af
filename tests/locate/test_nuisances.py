from dataclasses import replace
from functools import partial
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from detect.warp import sample
from locate.simulation.billboards import FIRST_BILLBOARD, BillboardSurfaces, stand_billboard
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.capture import CaptureSetup, RenderedFrames, render_frames
from locate.simulation.compression import compress_h264, compress_h265, compress_jpeg
from locate.simulation.nuisances import NUISANCES, apply_nuisances, draw_nuisances
from locate.simulation.recording import write_recording
from locate.simulation.render import Renderer
from locate.simulation.scene import Scene
from locate.simulation.shutter import Shutter, camera_velocities
from locate.simulation.surfaces import StaticSurfaces
from locate.simulation.textures import TEXTURE_PX, TextureAtlas

WIDTH, HEIGHT, FOCAL_PX, RANGE_M, WALL_M = 128, 96, 110.0, 6.0, 9.0
PIXEL_M = WALL_M / FOCAL_PX
SCENE = Scene.model_validate(
    {
        "seed": 5,
        "camera": {"width": WIDTH, "height": HEIGHT, "focal_px": FOCAL_PX},
        "video": {"frames": 4, "fps": 15},
        "image": {"noise": 0, "psf_sigma_px": 0},
        "path": {"kind": "hover", "target": [0, 0, 2], "radius_m": RANGE_M, "height_m": 2,
                 "start_deg": -90},
    }
)  # fmt: skip
PLUME = {
    "kind": "gaussian",
    "source": [0, 0, 0.2],
    "radius_m": 0.35,
    "height_m": 4,
    "amplitude_px": 1.5,
}


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    noise = np.random.default_rng(0).standard_normal((512, 512)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    path = tmp_path_factory.mktemp("photos") / "noise.png"
    cv2.imwrite(str(path), (128 + 45 * smooth / smooth.std()).clip(0, 255).astype(np.uint8))
    return path


@pytest.fixture
def capture(photo: Path) -> CaptureSetup:
    """A photo wall, one of its pixels a pixel of the camera."""
    wall = stand_billboard(-60, WALL_M - RANGE_M, -60, size_m=(120, 120), texel_m=PIXEL_M)
    return CaptureSetup(scene=SCENE, photos=(photo,), billboards=(wall,))


def changed(capture: CaptureSetup, **changes: object) -> CaptureSetup:
    scene = Scene.model_validate(capture.scene.model_dump() | changes)
    return replace(capture, scene=scene)


def path_of(**changes: object) -> dict[str, object]:
    return SCENE.path.model_dump() | changes


def rms(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(np.mean((one.astype(float) - other.astype(float)) ** 2)))


def inner_part(mask: np.ndarray) -> np.ndarray:
    return cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)


def test_a_wall_of_a_photo_shows_the_photo(capture: CaptureSetup, photo: Path) -> None:
    image = render_frames(capture).images[0].astype(np.float32)
    shown = cv2.imread(str(photo), cv2.IMREAD_GRAYSCALE).astype(np.float32)
    tiled = np.pad(shown, 512, mode="symmetric")
    score = cv2.matchTemplate(tiled, image[10:-10, 10:-10], cv2.TM_CCOEFF_NORMED)
    mirrored = cv2.matchTemplate(tiled[:, ::-1].copy(), image[10:-10, 10:-10], cv2.TM_CCOEFF_NORMED)
    assert max(score.max(), mirrored.max()) > 0.9


def test_a_plume_moves_the_photo_as_its_truth_says(capture: CaptureSetup) -> None:
    with_plume = render_frames(changed(capture, plumes=[PLUME]))
    still, seen = render_frames(capture).images[0], with_plume.images[0]
    w = with_plume.truths[0].displacement
    pixels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1)
    predicted = sample(still, (pixels + w).astype(np.float32))
    there = with_plume.truths[0].mask
    assert there.sum() > 200
    assert rms(predicted[there], seen[there]) < 0.3 * rms(still[there], seen[there])


def test_who_walks_before_the_plume_hides_it(capture: CaptureSetup) -> None:
    stands = stand_billboard(
        -1, -2, 0, size_m=(1, 4), texel_m=0.01, velocity_mps=np.array([3.0, 0, 0])
    )
    rendered = render_frames(
        replace(changed(capture, plumes=[PLUME]), billboards=(*capture.billboards, stands))
    )
    first, last = rendered.truths[0], rendered.truths[-1]
    in_front = np.isclose(first.depth, RANGE_M - 2, atol=0.01)
    assert in_front.sum() > 500
    assert np.abs(first.displacement[inner_part(in_front)]).max() < 1e-3
    assert np.abs(first.displacement).max() > 0.5
    moved_px = 3 * 3 / 15 / (RANGE_M - 2) * FOCAL_PX
    columns = [np.flatnonzero(np.isclose(t.depth, 4, atol=0.01).any(axis=0)) for t in (first, last)]
    assert columns[1].max() - columns[0].max() == pytest.approx(moved_px, abs=1.5)


def test_wind_moves_what_sways_and_nothing_else(capture: CaptureSetup) -> None:
    bush = stand_billboard(-1, 0, 1, size_m=(2, 2), texel_m=0.05, sway_m=0.2)
    rendered = render_frames(replace(capture, billboards=(*capture.billboards, bush)))
    far = rendered.truths[0].depth > RANGE_M + 1
    one, other = rendered.images[0], rendered.images[2]
    inner = inner_part(far & (rendered.truths[2].depth > RANGE_M + 1))
    np.testing.assert_array_equal(one[inner], other[inner])
    assert rms(one[~far], other[~far]) > 5


def test_a_glint_depends_on_where_it_is_seen_from(photo: Path) -> None:
    noise = np.full((TEXTURE_PX, TEXTURE_PX), 0.3, np.float32)
    flat = TextureAtlas([np.zeros((TEXTURE_PX, TEXTURE_PX), np.float32)])
    billboard = stand_billboard(-5, 0, -5, size_m=(10, 10), gloss=1.0, lamp=np.array([0.0, -1, 0]))
    seen = {}
    for gloss in (0.0, 1.0):
        world = BillboardSurfaces(
            [replace(billboard, gloss=gloss)], TextureAtlas([noise]), StaticSurfaces(SCENE), flat
        )
        eyes = np.array([[0, -5, 0], [2, -5, 0]], np.float32)
        rays = -eyes / np.linalg.norm(eyes, axis=1, keepdims=True)
        hits = world.cast_rays(eyes, rays)
        assert (hits.triangle == FIRST_BILLBOARD).all()
        seen[gloss] = world.compute_radiance(
            eyes, rays, hits, path_m=hits.range_m, ray_width_rad=1e-3
        ).tolist()
    assert seen[0.0] == pytest.approx([0.3, 0.3], abs=0.01)
    assert seen[1.0][0] == pytest.approx(1.3, abs=0.02)
    assert seen[1.0][1] == pytest.approx(0.3, abs=0.02)


@pytest.fixture
def panning(capture: CaptureSetup) -> CaptureSetup:
    edge = stand_billboard(0, 2, -60, size_m=(60, 120), photo=1, texel_m=1.0)
    made = changed(capture, path=path_of(kind="orbit", arc_deg=12.0))
    return replace(
        made, photos=(capture.photos[0], capture.photos[0]), billboards=(*capture.billboards, edge)
    )


def edge_columns(rendered: RenderedFrames, frame: int) -> np.ndarray:
    """Where the near billboard begins, in each row."""
    near = rendered.truths[frame].depth < 8.6
    return np.asarray(near.argmax(axis=1), dtype=float)


def test_a_rolling_shutter_slants_upright_edges(panning: CaptureSetup) -> None:
    readout_s = 0.06
    frames = [edge_columns(render_frames(panning), i) for i in (1, 2)]
    a_frame_px = np.median(frames[1] - frames[0])
    rolled = edge_columns(render_frames(replace(panning, shutter=Shutter(readout_s=readout_s))), 1)
    slant_px = np.polyfit(np.arange(HEIGHT), rolled, 1)[0] * HEIGHT
    assert abs(a_frame_px) > 1
    assert slant_px == pytest.approx(a_frame_px * readout_s * SCENE.video.fps, abs=0.6)
    assert rolled[HEIGHT // 2] == pytest.approx(frames[0][HEIGHT // 2], abs=1)


def test_exposure_blurs_along_the_motion(panning: CaptureSetup) -> None:
    def contrast(images: list[np.ndarray], axis: int) -> float:
        return float(np.abs(np.diff(images[1].astype(float), axis=axis)).mean())

    sharp, blurred = (
        render_frames(panning),
        render_frames(replace(panning, shutter=Shutter(exposure_s=0.06))),
    )
    assert contrast(blurred.images, 1) < 0.87 * contrast(sharp.images, 1)
    assert contrast(blurred.images, 0) > 0.9 * contrast(sharp.images, 0)


def test_velocities_are_those_of_the_path() -> None:
    scene = SCENE.model_copy(
        update={"path": SCENE.path.model_copy(update={"kind": "orbit", "arc_deg": 9.0})}
    )
    moving, turning = camera_velocities(simulate_trajectory(scene), 1)
    rate = np.radians(9.0) / (3 / 15)
    np.testing.assert_allclose(turning, [0, 0, rate], atol=0.01)
    assert np.linalg.norm(moving) == pytest.approx(rate * RANGE_M, rel=0.01)


def test_a_shutter_of_no_time_changes_nothing(capture: CaptureSetup) -> None:
    trajectory = simulate_trajectory(capture.scene)
    plain = Renderer(capture.scene, StaticSurfaces(capture.scene), [], trajectory)
    timed = Renderer(
        capture.scene, StaticSurfaces(capture.scene), [], trajectory, Shutter(gains=(1.0,) * 4)
    )
    np.testing.assert_array_equal(plain.render_frame(1)[0], timed.render_frame(1)[0])


def test_the_exposure_of_a_frame_brightens_it(capture: CaptureSetup) -> None:
    rendered = render_frames(replace(capture, shutter=Shutter(gains=(1.0, 0.8, 1.0, 1.2))))
    means = [image.mean() for image in rendered.images]
    assert means[1] == pytest.approx(means[0] * 0.8 ** (1 / 2.2), rel=0.02)
    assert means[3] > means[2] > means[1]


def test_a_recording_holds_the_take_as_filmed(capture: CaptureSetup, tmp_path: Path) -> None:
    spoilt = replace(
        capture, shutter=Shutter(readout_s=0.02), coding=partial(compress_jpeg, quality=60)
    )
    write_recording(spoilt, tmp_path)
    with av.open(str(tmp_path / "video.mkv")) as video:
        kept = [frame.to_ndarray(format="gray") for frame in video.decode(video=0)]
    for image, filmed in zip(kept, render_frames(spoilt).images, strict=True):
        np.testing.assert_array_equal(image, filmed)
    assert len(list((tmp_path / "truth").iterdir())) == len(kept)


def test_the_chain_is_not_told_of_the_lens(capture: CaptureSetup) -> None:
    rng = np.random.default_rng(1)
    bent = NUISANCES["distortion"](capture, rng)
    assert bent.scene.camera.build().model == "SIMPLE_RADIAL"
    rendered = render_frames(NUISANCES["wrong_focal"](bent, rng))
    assert rendered.trajectory.camera.is_pinhole
    assert abs(rendered.trajectory.camera.focal_px / FOCAL_PX - 1) == pytest.approx(0.01)
    assert rms(rendered.images[0], render_frames(capture).images[0]) > 3


@pytest.mark.parametrize(
    ("worse", "better"),
    [
        (partial(compress_jpeg, quality=60), partial(compress_jpeg, quality=95)),
        (partial(compress_h264, bits_per_pixel=0.15), partial(compress_h264, bits_per_pixel=3.0)),
        (partial(compress_h265, bits_per_pixel=0.15), partial(compress_h265, bits_per_pixel=3.0)),
    ],
)
def test_fewer_bits_store_less(capture: CaptureSetup, worse: partial, better: partial) -> None:
    images = render_frames(changed(capture, path=path_of(kind="orbit", arc_deg=12.0))).images
    much, little = (
        rms(np.array(coding(images, 15.0).images), np.array(images)) for coding in (better, worse)
    )
    assert little > 2 * much
    assert much < 6


def test_b_frames_are_known_and_hold_less(capture: CaptureSetup) -> None:
    video = {"frames": 12, "fps": 15}
    moving = changed(capture, path=path_of(kind="orbit", arc_deg=12.0), video=video)
    plain = render_frames(moving)
    assert len(plain.b_frames) == 0
    coding = partial(compress_h264, bits_per_pixel=0.3)
    coded = render_frames(replace(moving, coding=coding))
    lost = [rms(a, b) for a, b in zip(coded.images, plain.images, strict=True)]
    is_b = np.isin(np.arange(12), coded.b_frames)
    assert 3 <= is_b.sum() <= 9
    assert np.mean(np.array(lost)[is_b]) > np.mean(np.array(lost)[~is_b])


def test_every_nuisance_changes_the_film_and_repeats(capture: CaptureSetup) -> None:
    capture = changed(
        capture, path=path_of(kind="orbit", arc_deg=12.0), video={"frames": 3, "fps": 15}
    )
    plain = np.array(render_frames(capture).images)
    for name in NUISANCES:
        one, again = (
            render_frames(apply_nuisances(capture, [name], np.random.default_rng(3)))
            for _ in range(2)
        )
        np.testing.assert_array_equal(one.images, again.images, err_msg=name)
        told_the_truth = one.trajectory.camera.focal_px == pytest.approx(FOCAL_PX)
        assert (rms(plain, np.array(one.images)) > 0.3) or not told_the_truth, name


def test_most_takes_have_few_nuisances() -> None:
    drawn = [draw_nuisances(np.random.default_rng(seed)) for seed in range(300)]
    counts = np.bincount([len(names) for names in drawn])
    assert len(counts) == 4
    assert counts[0] == pytest.approx(105, abs=30)
    assert {name for names in drawn for name in names} == set(NUISANCES)
