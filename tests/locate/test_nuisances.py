from dataclasses import replace
from functools import partial
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from detect.warp import sample
from locate.simulation.billboards import FIRST_BILLBOARD, BillboardWorld, stand_billboard
from locate.simulation.camera_paths import fly
from locate.simulation.capture import Footage, Take, film
from locate.simulation.compression import h264, jpeg
from locate.simulation.nuisances import NUISANCES, some_nuisances, spoiled
from locate.simulation.recording import record
from locate.simulation.render import Renderer
from locate.simulation.scene import Scene
from locate.simulation.shutter import Shutter, velocities
from locate.simulation.surfaces import World
from locate.simulation.textures import TILE_PX, TileAtlas

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
def take(photo: Path) -> Take:
    """A photo wall, one of its pixels a pixel of the camera."""
    wall = stand_billboard(-60, WALL_M - RANGE_M, -60, size_m=(120, 120), texel_m=PIXEL_M)
    return Take(scene=SCENE, photos=(photo,), billboards=(wall,))


def changed(take: Take, **changes: object) -> Take:
    scene = Scene.model_validate(take.scene.model_dump() | changes)
    return replace(take, scene=scene)


def path_of(**changes: object) -> dict[str, object]:
    return SCENE.path.model_dump() | changes


def rms(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(np.mean((one.astype(float) - other.astype(float)) ** 2)))


def inner_part(mask: np.ndarray) -> np.ndarray:
    return cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)


def test_a_wall_of_a_photo_shows_the_photo(take: Take, photo: Path) -> None:
    image = film(take).images[0].astype(np.float32)
    shown = cv2.imread(str(photo), cv2.IMREAD_GRAYSCALE).astype(np.float32)
    tiled = np.pad(shown, 512, mode="symmetric")
    score = cv2.matchTemplate(tiled, image[10:-10, 10:-10], cv2.TM_CCOEFF_NORMED)
    mirrored = cv2.matchTemplate(tiled[:, ::-1].copy(), image[10:-10, 10:-10], cv2.TM_CCOEFF_NORMED)
    assert max(score.max(), mirrored.max()) > 0.9


def test_a_plume_moves_the_photo_as_its_truth_says(take: Take) -> None:
    with_plume = film(changed(take, plumes=[PLUME]))
    still, seen = film(take).images[0], with_plume.images[0]
    w = with_plume.truths[0].displacement
    pixels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1)
    predicted = sample(still, (pixels + w).astype(np.float32))
    there = with_plume.truths[0].mask
    assert there.sum() > 200
    assert rms(predicted[there], seen[there]) < 0.3 * rms(still[there], seen[there])


def test_who_walks_before_the_plume_hides_it(take: Take) -> None:
    stands = stand_billboard(
        -1, -2, 0, size_m=(1, 4), texel_m=0.01, velocity_mps=np.array([3.0, 0, 0])
    )
    footage = film(replace(changed(take, plumes=[PLUME]), billboards=(*take.billboards, stands)))
    first, last = footage.truths[0], footage.truths[-1]
    in_front = np.isclose(first.depth, RANGE_M - 2, atol=0.01)
    assert in_front.sum() > 500
    assert np.abs(first.displacement[inner_part(in_front)]).max() < 1e-3
    assert np.abs(first.displacement).max() > 0.5
    moved_px = 3 * 3 / 15 / (RANGE_M - 2) * FOCAL_PX
    columns = [np.flatnonzero(np.isclose(t.depth, 4, atol=0.01).any(axis=0)) for t in (first, last)]
    assert columns[1].max() - columns[0].max() == pytest.approx(moved_px, abs=1.5)


def test_wind_moves_what_sways_and_nothing_else(take: Take) -> None:
    bush = stand_billboard(-1, 0, 1, size_m=(2, 2), texel_m=0.05, sway_m=0.2)
    footage = film(replace(take, billboards=(*take.billboards, bush)))
    far = footage.truths[0].depth > RANGE_M + 1
    one, other = footage.images[0], footage.images[2]
    inner = inner_part(far & (footage.truths[2].depth > RANGE_M + 1))
    np.testing.assert_array_equal(one[inner], other[inner])
    assert rms(one[~far], other[~far]) > 5


def test_a_glint_depends_on_where_it_is_seen_from(photo: Path) -> None:
    noise = np.full((TILE_PX, TILE_PX), 0.3, np.float32)
    flat = TileAtlas([np.zeros((TILE_PX, TILE_PX), np.float32)])
    billboard = stand_billboard(-5, 0, -5, size_m=(10, 10), gloss=1.0, lamp=np.array([0.0, -1, 0]))
    seen = {}
    for gloss in (0.0, 1.0):
        world = BillboardWorld(
            [replace(billboard, gloss=gloss)], TileAtlas([noise]), World(SCENE), flat
        )
        eyes = np.array([[0, -5, 0], [2, -5, 0]], np.float32)
        rays = -eyes / np.linalg.norm(eyes, axis=1, keepdims=True)
        hits = world.cast(eyes, rays)
        assert (hits.triangle == FIRST_BILLBOARD).all()
        seen[gloss] = world.radiance(
            eyes, rays, hits, path_m=hits.range_m, ray_width_rad=1e-3
        ).tolist()
    assert seen[0.0] == pytest.approx([0.3, 0.3], abs=0.01)
    assert seen[1.0][0] == pytest.approx(1.3, abs=0.02)
    assert seen[1.0][1] == pytest.approx(0.3, abs=0.02)


@pytest.fixture
def panning(take: Take) -> Take:
    edge = stand_billboard(0, 2, -60, size_m=(60, 120), photo=1, texel_m=1.0)
    made = changed(take, path=path_of(kind="orbit", arc_deg=12.0))
    return replace(
        made, photos=(take.photos[0], take.photos[0]), billboards=(*take.billboards, edge)
    )


def edge_columns(footage: Footage, frame: int) -> np.ndarray:
    """Where the near billboard begins, in each row."""
    near = footage.truths[frame].depth < 8.6
    return np.asarray(near.argmax(axis=1), dtype=float)


def test_a_rolling_shutter_slants_upright_edges(panning: Take) -> None:
    readout_s = 0.06
    frames = [edge_columns(film(panning), i) for i in (1, 2)]
    a_frame_px = np.median(frames[1] - frames[0])
    rolled = edge_columns(film(replace(panning, shutter=Shutter(readout_s=readout_s))), 1)
    slant_px = np.polyfit(np.arange(HEIGHT), rolled, 1)[0] * HEIGHT
    assert abs(a_frame_px) > 1
    assert slant_px == pytest.approx(a_frame_px * readout_s * SCENE.video.fps, abs=0.6)
    assert rolled[HEIGHT // 2] == pytest.approx(frames[0][HEIGHT // 2], abs=1)


def test_exposure_blurs_along_the_motion(panning: Take) -> None:
    def contrast(images: list[np.ndarray], axis: int) -> float:
        return float(np.abs(np.diff(images[1].astype(float), axis=axis)).mean())

    sharp, blurred = film(panning), film(replace(panning, shutter=Shutter(exposure_s=0.06)))
    assert contrast(blurred.images, 1) < 0.87 * contrast(sharp.images, 1)
    assert contrast(blurred.images, 0) > 0.9 * contrast(sharp.images, 0)


def test_velocities_are_those_of_the_path() -> None:
    scene = SCENE.model_copy(
        update={"path": SCENE.path.model_copy(update={"kind": "orbit", "arc_deg": 9.0})}
    )
    moving, turning = velocities(fly(scene), 1)
    rate = np.radians(9.0) / (3 / 15)
    np.testing.assert_allclose(turning, [0, 0, rate], atol=0.01)
    assert np.linalg.norm(moving) == pytest.approx(rate * RANGE_M, rel=0.01)


def test_a_shutter_of_no_time_changes_nothing(take: Take) -> None:
    trajectory = fly(take.scene)
    plain = Renderer(take.scene, World(take.scene), [], trajectory)
    timed = Renderer(take.scene, World(take.scene), [], trajectory, Shutter(gains=(1.0,) * 4))
    np.testing.assert_array_equal(plain.render(1)[0], timed.render(1)[0])


def test_the_exposure_of_a_frame_brightens_it(take: Take) -> None:
    footage = film(replace(take, shutter=Shutter(gains=(1.0, 0.8, 1.0, 1.2))))
    means = [image.mean() for image in footage.images]
    assert means[1] == pytest.approx(means[0] * 0.8 ** (1 / 2.2), rel=0.02)
    assert means[3] > means[2] > means[1]


def test_a_recording_holds_the_take_as_filmed(take: Take, tmp_path: Path) -> None:
    spoilt = replace(take, shutter=Shutter(readout_s=0.02), coding=partial(jpeg, quality=60))
    record(spoilt, tmp_path)
    with av.open(str(tmp_path / "video.mkv")) as video:
        kept = [frame.to_ndarray(format="gray") for frame in video.decode(video=0)]
    for image, filmed in zip(kept, film(spoilt).images, strict=True):
        np.testing.assert_array_equal(image, filmed)
    assert len(list((tmp_path / "truth").iterdir())) == len(kept)


def test_the_chain_is_not_told_of_the_lens(take: Take) -> None:
    rng = np.random.default_rng(1)
    bent = NUISANCES["distortion"](take, rng)
    assert bent.scene.camera.build().model == "SIMPLE_RADIAL"
    footage = film(NUISANCES["wrong_focal"](bent, rng))
    assert footage.trajectory.camera.is_pinhole
    assert abs(footage.trajectory.camera.focal_px / FOCAL_PX - 1) == pytest.approx(0.01)
    assert rms(footage.images[0], film(take).images[0]) > 3


@pytest.mark.parametrize(
    ("worse", "better"),
    [
        (partial(jpeg, quality=60), partial(jpeg, quality=95)),
        (partial(h264, bits_per_pixel=0.15), partial(h264, bits_per_pixel=3.0)),
    ],
)
def test_fewer_bits_store_less(take: Take, worse: partial, better: partial) -> None:
    images = film(changed(take, path=path_of(kind="orbit", arc_deg=12.0))).images
    much, little = (
        rms(np.array(coding(images, 15.0)), np.array(images)) for coding in (better, worse)
    )
    assert little > 2 * much
    assert much < 6


def test_every_nuisance_changes_the_film_and_repeats(take: Take) -> None:
    take = changed(take, path=path_of(kind="orbit", arc_deg=12.0), video={"frames": 3, "fps": 15})
    plain = np.array(film(take).images)
    for name in NUISANCES:
        one, again = (film(spoiled(take, [name], np.random.default_rng(3))) for _ in range(2))
        np.testing.assert_array_equal(one.images, again.images, err_msg=name)
        told_the_truth = one.trajectory.camera.focal_px == pytest.approx(FOCAL_PX)
        assert (rms(plain, np.array(one.images)) > 0.3) or not told_the_truth, name


def test_most_takes_have_few_nuisances() -> None:
    drawn = [some_nuisances(np.random.default_rng(seed)) for seed in range(300)]
    counts = np.bincount([len(names) for names in drawn])
    assert len(counts) == 4
    assert counts[0] == pytest.approx(105, abs=30)
    assert {name for names in drawn for name in names} == set(NUISANCES)
