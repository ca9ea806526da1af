import json
from itertools import product

import av
import cv2
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from detect.synthesis.buoyancy import BuoyantFlow
from geometry.errors import BadInputError
from geometry.refraction import gaussian_column_deflection, refractivity
from geometry.trajectory import Trajectory
from locate.cli import app
from locate.simulation import (
    Campaign,
    Scene,
    is_campaign,
    random_scene,
    render_onto,
    render_onto_set,
    render_strengths_onto_set,
    simulate,
)
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.photo_overlay import displace_photo
from locate.simulation.photo_set import PhotoSet
from locate.simulation.plume_field import PlumeField, visible_percentile
from locate.simulation.render import Renderer
from locate.simulation.scene import ImageBlock
from locate.simulation.surfaces import StaticSurfaces

PLUME_M, WALL_M, RADIUS_M = 6.0, 12.0, 0.25
WALL_FACE_M = WALL_M - 0.1
SCENE = {
    "seed": 3,
    "camera": {"width": 160, "height": 120, "focal_px": 200},
    "video": {"frames": 2},
    "image": {"noise": 0},
    "path": {"kind": "hover", "target": [0, 0, 2], "radius_m": PLUME_M, "height_m": 2,
             "start_deg": -90},
    "objects": [
        {"kind": "ground"},
        {"kind": "wall", "start": [-20, WALL_M - PLUME_M], "end": [20, WALL_M - PLUME_M],
         "height_m": 9, "thickness_m": 0.2, "material": "brick"},
        {"kind": "box", "center": [-1.5, 1, 0.5], "size": [1, 1, 1], "material": "planks"},
    ],
    "plumes": [
        {"kind": "gaussian", "source": [0, 0, 0.5], "radius_m": RADIUS_M, "height_m": 3,
         "temperature_k": 600},
    ],
}  # fmt: skip


def scene(**changes) -> Scene:
    return Scene.model_validate(SCENE | changes)


def renderer_of(made: Scene) -> Renderer:
    fields = [PlumeField(made, number) for number in range(len(made.plumes))]
    return Renderer(made, StaticSurfaces(made), fields, simulate_trajectory(made))


@pytest.fixture(scope="module")
def column() -> Renderer:
    return renderer_of(scene())


@pytest.fixture(scope="module")
def strong() -> Renderer:
    plume = SCENE["plumes"][0] | {"amplitude_px": 2.0}
    return renderer_of(scene(plumes=[plume]))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording")
    simulate(scene(path=SCENE["path"] | {"kind": "orbit"}, image={"noise": 2.0}), folder)
    return folder


def test_gaussian_column_bends_as_the_formula_says(column):
    _, truth = column.render_frame(0)
    x = np.arange(160) - 79.5
    delta_n = refractivity(temperature_k=600) - refractivity()
    passes_at_m = PLUME_M * x / np.hypot(x, 200)
    eps = gaussian_column_deflection(passes_at_m, delta_n=float(delta_n), radius_m=RADIUS_M)
    expected = 200 * (WALL_FACE_M - PLUME_M) / WALL_FACE_M * eps
    np.testing.assert_allclose(truth.displacement[60, :, 0], expected, atol=0.02 * expected.max())
    assert np.abs(truth.displacement[60, :, 1]).max() < 0.02 * expected.max()


def test_depth_is_along_the_optical_axis(column):
    _, truth = column.render_frame(0)
    np.testing.assert_allclose(truth.depth[50], WALL_FACE_M, rtol=1e-4)


def test_displacement_has_the_sign_of_remap(strong):
    distorted, truth = strong.render_frame(0)
    clean, nothing = strong.render_frame(0, with_plumes=False)
    assert not nothing.displacement.any()
    assert not nothing.mask.any()
    grid = strong.camera.pixel_grid()

    def residual(sign: int) -> float:
        place = grid + sign * truth.displacement
        moved = cv2.remap(clean, place[..., 0], place[..., 1], cv2.INTER_LINEAR)
        return float(np.abs(moved.astype(float) - distorted)[truth.mask].mean())

    assert residual(1) < 0.4 * residual(0) < 0.4 * residual(-1)


def test_amplitude_is_reached(strong):
    _, truth = strong.render_frame(0)
    assert visible_percentile(truth.displacement) == pytest.approx(2.0, rel=0.05)
    assert strong.amplitudes_px == [2.0]


def test_what_stands_before_the_plume_is_sharp():
    screen = {"kind": "box", "center": [0, -1, 1], "size": [3, 0.2, 2], "material": "concrete"}
    hidden = renderer_of(scene(objects=[*SCENE["objects"], screen]))
    _, truth = hidden.render_frame(0)
    before = truth.depth < PLUME_M - 0.5
    assert before.any()
    assert np.abs(truth.displacement[before]).max() == 0
    assert truth.mask[~before].any()


def test_plume_of_no_strength_shows_nothing():
    plume = SCENE["plumes"][0] | {"amplitude_px": 0.0}
    made = renderer_of(scene(plumes=[plume]))
    image, truth = made.render_frame(0)
    clean, _ = made.render_frame(0, with_plumes=False)
    assert not truth.displacement.any()
    np.testing.assert_array_equal(image, clean)


def test_files_are_what_they_should_be(recording):
    trajectory = Trajectory.load(recording / "truth.json")
    assert trajectory.metric
    assert trajectory.gravity
    content = json.loads((recording / "truth.json").read_text())
    assert content["schema"] == "locate.truth/1"
    plume = content["plumes"][0]
    assert plume["source"] == [0, 0, 0.5]
    assert plume["axis"] == [0, 0, 1]
    with np.load(recording / "truth" / "000001.npz") as truth:
        assert truth["displacement"].shape == (120, 160, 2)
        assert truth["displacement"].dtype == np.float16
        assert truth["mask"].dtype == bool
        assert truth["depth"].shape == (120, 160)
    with av.open(str(recording / "video.mkv")) as video:
        frames = [(frame.time, frame.to_ndarray(format="gray")) for frame in video.decode(video=0)]
    assert [time for time, _ in frames] == pytest.approx([0, 1 / 15], abs=1e-3)
    assert frames[0][1].std() > 10


def test_video_is_lossless_and_made_again_the_same(recording):
    made = Scene.load(recording / "scene.yaml")
    expected, _ = renderer_of(made).render_frame(0)
    with av.open(str(recording / "video.mkv")) as video:
        frame = next(video.decode(video=0))
    np.testing.assert_array_equal(frame.to_ndarray(format="gray"), expected)


def test_h264_is_written_when_asked(tmp_path):
    simulate(scene(video={"frames": 2, "codec": "h264"}, plumes=[]), tmp_path)
    with av.open(str(tmp_path / "video.mp4")) as video:
        assert sum(1 for _ in video.decode(video=0)) == 2


def test_poses_put_known_points_where_they_are_seen():
    lone = scene(
        objects=[{"kind": "box", "center": [0.5, 0, 2.4], "size": [0.2, 0.2, 0.2]}],
        plumes=[],
        path=SCENE["path"] | {"kind": "orbit", "jitter_m": 0.05, "jitter_deg": 1.0},
    )
    made = renderer_of(lone)
    for i in range(2):
        _, truth = made.render_frame(i)
        y, x = np.nonzero(np.isfinite(truth.depth))
        corners = np.array(list(product([0.4, 0.6], [-0.1, 0.1], [2.3, 2.5])))
        projected = simulate_trajectory(lone).project(i, corners)
        np.testing.assert_allclose([x.min(), y.min()], projected.min(axis=0), atol=0.8)
        np.testing.assert_allclose([x.max(), y.max()], projected.max(axis=0), atol=0.8)


@pytest.mark.parametrize("kind", ["orbit", "handheld", "approach", "hover", "lawn_mower"])
def test_paths_keep_the_target_in_view(kind):
    path = {"kind": kind, "height_m": 6 if kind == "lawn_mower" else 2, "jitter_m": 0.03}
    flown = simulate_trajectory(scene(path=path, video={"frames": 20}))
    pixels = flown.project(10, np.array([0.0, 0.0, 2.5]))
    assert (np.abs(pixels - [79.5, 59.5]) < [80, 60]).all()
    steps = np.linalg.norm(np.diff(flown.centers_in_world, axis=0), axis=1)
    assert steps.max() < 8 * max(np.median(steps), 0.02)


def test_radial_distortion_reaches_the_truth():
    bent = scene(camera=SCENE["camera"] | {"radial": -0.1}, plumes=[])
    flown = simulate_trajectory(bent)
    assert flown.camera.model == "SIMPLE_RADIAL"
    corner = renderer_of(bent).render_frame(0)[1].depth[0, 0]
    assert corner == pytest.approx(WALL_FACE_M, rel=1e-3)


def test_flow_rises_and_stays_divergence_free():
    def grown(seed: int) -> BuoyantFlow:
        flow = BuoyantFlow(
            (20, 20, 32), cell_m=0.08, radius_m=0.2, deficit=0.3, exit_mps=0.4,
            rng=np.random.default_rng(seed),
        )  # fmt: skip
        flow.advance(0.8)
        return flow

    one, same, other = grown(0), grown(0), grown(1)
    np.testing.assert_array_equal(one.state, same.state)
    assert np.abs(one.tracer - other.tracer).max() > 0.05
    assert one.rise_mps() > 0.3
    assert one.tracer.min() >= -0.1
    velocity = one.state[..., :3].transpose(3, 0, 1, 2)
    waves = [np.fft.fftfreq(n) for n in one.shape]
    spectrum = np.fft.fftn(velocity, axes=(1, 2, 3))
    divergence = sum(
        k * s for k, s in zip(np.meshgrid(*waves, indexing="ij"), spectrum, strict=True)
    )
    inside = (slice(1, 10),) * 3
    assert np.abs(divergence[inside]).max() < 1e-4 * np.abs(spectrum).max()


def test_buoyant_plume_moves_and_leans_with_the_wind(monkeypatch):
    monkeypatch.setattr("locate.simulation.plume_field.CELLS", (20, 20, 32))
    plume = {"source": [0, 0, 1], "radius_m": 0.2, "height_m": 2.5, "amplitude_px": 1.0}
    made = scene(plumes=[plume], wind_mps=[0.3, 0.0])
    windy = renderer_of(made)
    w = [windy.render_frame(i)[1].displacement for i in range(2)]
    assert np.abs(w[1] - w[0]).max() > 0.05
    assert visible_percentile(np.array(w)) == pytest.approx(1.0, rel=0.15)
    axis = PlumeField(made, 0).axis_in_world
    assert axis[0] > 0.1
    assert axis[2] > 0.5
    rows, columns = np.nonzero(np.linalg.norm(w[0], axis=-1) > 0.2)
    assert columns[rows < np.median(rows)].mean() > columns[rows > np.median(rows)].mean()


def test_heavy_gas_sinks():
    plume = SCENE["plumes"][0] | {"gas": "sf6", "temperature_k": 288, "source": [0, 0, 3]}
    field = PlumeField(scene(plumes=[plume]), 0)
    np.testing.assert_array_equal(field.axis_in_world, [0, 0, -1])


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("objects: [", "not YAML"),
        ("- 1", "expected a mapping"),
        ("camera: {widht: 640}", "camera.widht"),
        ("video: {frames: 0}", "video.frames"),
        ("objects: [{kind: ground, material: cheese}]", "cheese"),
        ("objects: [{kind: sphere}]", "objects.0"),
        ("plumes: [{source: [0, 0, 0], gas: steam}]", "steam"),
        ("plumes: [{source: [0, 0, 0], amplitude_px: .inf}]", "plumes.0.amplitude_px"),
        ("path: {target: [.inf, 0, 0]}", "path.target.0"),
        ("video: {fps: 0.0001}", "video.fps"),
        ("seed: -1", "seed"),
        ("camera: {width: 161}\nvideo: {codec: h264}", "even camera.width"),
        ("objects: [{kind: wall, start: [1, 2], end: [1, 2]}]", "objects.0.wall: start and end"),
        ("objects: [{kind: cylinder, start: [1, 2, 3], end: [1, 2, 3]}]", "objects.0.cylinder"),
        ("objects: [{kind: pipe_rack, levels_m: []}]", "levels_m"),
    ],
)
def test_bad_scene_is_named(tmp_path, text, named):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with pytest.raises(BadInputError, match=r"scene\.yaml") as error:
        Scene.load(path)
    assert named in str(error.value)
    assert "\n" not in str(error.value)


def test_missing_scene_is_bad_input(tmp_path):
    with pytest.raises(BadInputError, match=r"nowhere\.yaml"):
        Scene.load(tmp_path / "nowhere.yaml")


def test_output_that_is_a_file_is_bad_input(tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(BadInputError, match="taken"):
        simulate(scene(), tmp_path / "taken")


def test_random_scenes_differ_and_survive_the_file(tmp_path):
    one, other = random_scene(1, plume=True), random_scene(2, plume=True)
    assert one.objects != other.objects
    assert one == random_scene(1, plume=True)
    assert random_scene(1, plume=False).objects == one.objects
    one.save(tmp_path / "scene.yaml")
    assert Scene.load(tmp_path / "scene.yaml") == one


def test_example_scenes_are_valid(request):
    folder = request.config.rootpath / "examples" / "scenes"
    paths = sorted(folder.glob("*.yaml"))
    assert len(paths) >= 6
    for path in paths:
        assert Campaign.load(path).flights if is_campaign(path) else Scene.load(path).objects


def photo_set(folder):
    """Three posed photos of noise in Strecha's layout, in a world whose Z points down."""
    (folder / "images").mkdir()
    rng = np.random.default_rng(5)
    for i in range(3):
        photo = cv2.GaussianBlur(rng.uniform(0, 255, (240, 320)).astype(np.float32), (0, 0), 1)
        photo = np.clip((photo - 128) * 2 + 128, 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / "images" / f"{i}.png"), photo)
        numbers = [[400, 0, 159.5], [0, 400, 119.5], [0, 0, 1], [0, 0, 0],
                   [1, 0, 0], [0, 0, -1], [0, 1, 0], [0.3 * i, 6, -2], [320, 240]]  # fmt: skip
        text = "\n".join(" ".join(map(str, row)) for row in numbers)
        (folder / f"{i}.png.camera").write_text(text)


def test_onto_real_photos(tmp_path):
    photo_set(tmp_path)
    plume = {"kind": "gaussian", "source": [0.3, 0, -0.5], "radius_m": 0.2, "height_m": 3,
             "amplitude_px": 1.5}  # fmt: skip
    made = Scene.model_validate({"camera": {"width": 160}, "plumes": [plume]})
    render_onto(made, tmp_path, tmp_path / "out")
    trajectory = Trajectory.load(tmp_path / "out" / "truth.json")
    content = json.loads((tmp_path / "out" / "truth.json").read_text())
    assert trajectory.metric
    assert trajectory.camera.width == 160
    source = np.array(content["plumes"][0]["source"])
    np.testing.assert_allclose(trajectory.project(1, source), [79.5, 109.5], atol=0.6)
    with np.load(tmp_path / "out" / "truth" / "000001.npz") as truth:
        rows, _ = np.nonzero(truth["mask"])
        assert rows.max() == pytest.approx(109, abs=3), "the plume rises from its source"
        size = visible_percentile(truth["displacement"].astype(np.float32))
    assert size == pytest.approx(1.5, rel=0.1)
    image = cv2.imread(str(tmp_path / "out" / "frames" / "000001.png"), cv2.IMREAD_GRAYSCALE)
    assert image.shape == (120, 160)


def test_onto_real_photos_at_full_size(tmp_path):
    photo_set(tmp_path)
    plume = {"kind": "gaussian", "source": [0.3, 0, -0.5], "radius_m": 0.2, "height_m": 3,
             "amplitude_px": 1.5}  # fmt: skip
    made = Scene.model_validate({"image": {"noise": 0}, "plumes": [plume]})
    render_onto(made, tmp_path, tmp_path / "out", reduce=1)
    photo, image = (
        cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        for path in (tmp_path / "images" / "1.png", tmp_path / "out" / "frames" / "000001.png")
    )
    with np.load(tmp_path / "out" / "truth" / "000001.npz") as truth:
        w = truth["displacement"].astype(np.float32)
    assert image.shape == photo.shape == w.shape[:2] == (240, 320)
    assert visible_percentile(w) == pytest.approx(1.5, rel=0.1)
    still = ~w.any(axis=-1)
    assert 0.3 < still.mean() < 0.99
    assert np.array_equal(image[still], photo[still]), "what stands still keeps its grain"
    assert (image != photo)[~still].mean() > 0.5


def test_photos_are_bent_once_for_all_strengths(tmp_path, monkeypatch):
    photo_set(tmp_path)
    bent = []
    bend_rays = PlumeField.bend_rays

    def noted(field, frame, center_in_world, directions):
        bent.append(frame)
        return bend_rays(field, frame, center_in_world, directions)

    monkeypatch.setattr(PlumeField, "bend_rays", noted)
    plume = {"kind": "gaussian", "source": [0.3, 0, -0.5], "radius_m": 0.2, "height_m": 3}
    made = Scene.model_validate({"plumes": [plume]})
    photos = PhotoSet.load(tmp_path)
    outputs = {px: tmp_path / f"{px}" for px in (0.3, 6.0)}
    render_strengths_onto_set(made, photos, outputs, reduce=1)
    assert bent == [0, 1, 2]
    steps = []
    for px, folder in outputs.items():
        alone = made.model_copy(
            update={"plumes": (made.plumes[0].model_copy(update={"amplitude_px": px}),)}
        )
        render_onto_set(
            alone, photos, tmp_path / "alone", reduce=1, progress=lambda *step: steps.append(step)
        )
        for name in ("truth.json", "frames/000001.png"):
            assert (folder / name).read_bytes() == (tmp_path / "alone" / name).read_bytes(), name
        w = np.load(folder / "truth" / "000001.npz")["displacement"].astype(np.float32)
        assert visible_percentile(w) == pytest.approx(px, rel=0.1)
    assert steps[:6] == [(n, 6) for n in range(1, 7)]


def test_only_photos_are_reduced(tmp_path):
    Scene().save(tmp_path / "scene.yaml")
    wanted = ["simulate", str(tmp_path / "scene.yaml"), "-o", str(tmp_path / "o"), "--reduce", "1"]
    run = CliRunner().invoke(app, wanted)
    assert isinstance(run.exception, BadInputError)
    assert "--onto" in str(run.exception)


def test_photos_of_a_transforms_json(tmp_path):
    matrix = np.array([[1, 0, 0, 0.5], [0, 0, -1, -6], [0, 1, 0, 2], [0, 0, 0, 1]], dtype=float)
    frames = [{"file_path": f"images/{i}.png", "transform_matrix": matrix.tolist()} for i in (1, 0)]
    block = {"w": 64, "h": 48, "camera_angle_x": np.pi / 2, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(block))
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "1.png"), np.zeros((48, 64), np.uint8))
    photos = PhotoSet.load(tmp_path)
    assert [path.name for path in photos.paths] == ["1.png"], "poses without a photo are left out"
    assert photos.trajectory.camera.params == pytest.approx((32, 32, 31.5, 23.5))
    np.testing.assert_allclose(photos.trajectory.centers_in_world, [[0.5, -6, 2]])
    np.testing.assert_allclose(photos.trajectory.project(0, np.array([0.5, 0, 2])), [31.5, 23.5])


def test_photos_of_half_size_have_half_the_camera(tmp_path):
    photo_set(tmp_path)
    for path in (tmp_path / "images").iterdir():
        cv2.imwrite(str(path), np.zeros((120, 160), np.uint8))
    camera = PhotoSet.load(tmp_path).trajectory.camera
    assert (camera.width, camera.height) == (160, 120)
    assert camera.params == pytest.approx((200, 200, 79.5, 59.5))


def test_a_broken_camera_file_is_named(tmp_path):
    photo_set(tmp_path)
    (tmp_path / "1.png.camera").write_text("no numbers")
    with pytest.raises(BadInputError, match=r"1\.png\.camera"):
        PhotoSet.load(tmp_path)


def test_displaced_photos_are_as_sharp_as_others():
    rng = np.random.default_rng(0)
    photo = rng.integers(0, 255, (512, 512), dtype=np.uint8)

    def sharpness(shift_px: float) -> float:
        w = np.full((256, 256, 2), shift_px, dtype=np.float32)
        image = displace_photo(photo, w, 2, ImageBlock(noise=0), np.random.default_rng(0))
        return float(cv2.Laplacian(image.astype(np.float32), cv2.CV_32F)[8:-8, 8:-8].std())

    still = sharpness(0.0)
    for shift_px in (0.125, 0.25, 0.37):
        assert sharpness(shift_px) == pytest.approx(still, rel=0.003)


@pytest.mark.parametrize("content", [None, "empty", "broken"])
def test_unposed_photos_are_bad_input(tmp_path, content):
    folder = tmp_path / "photos"
    if content is not None:
        folder.mkdir()
    if content == "broken":
        (folder / "transforms.json").write_text(json.dumps({"frames": []}))
    with pytest.raises(BadInputError, match="photos"):
        render_onto(Scene(), folder, tmp_path / "out")


@pytest.mark.parametrize("name", ["lund_door", "strecha_fountain-P11", "fox_handheld"])
def test_real_photo_sets_load(shared_data, name):
    photos = PhotoSet.load(shared_data / "2_sfm" / name)
    assert len(photos.paths) >= 11
    assert photos.read_image(0).shape[0] == photos.trajectory.camera.height
    ups = -photos.trajectory.rotations[:, 1]
    assert (ups[:, 2] > 0.5).all(), "the cameras are held upright"
    if len(photos.points_in_world):
        seen = photos.trajectory.project(0, photos.points_in_world)
        assert np.isfinite(seen).all(axis=1).mean() > 0.9


def test_scene_files_use_no_yaml_tags(tmp_path):
    random_scene(4, plume=True).save(tmp_path / "scene.yaml")
    assert "!!" not in (tmp_path / "scene.yaml").read_text()
    assert isinstance(yaml.safe_load((tmp_path / "scene.yaml").read_text()), dict)
