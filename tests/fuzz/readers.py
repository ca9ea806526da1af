"""Every reader of files from outside, each with a small whole file that it reads."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import pycolmap

import detect
from detect.detection import Detection
from detect.dybs import DybsDetector
from detect.learning.clips import TrainingClip
from detect.learning.config import TrainConfig
from detect.network import Network
from detect.onnx_flow import OnnxFlow
from detect.registered.evidence_network import OUTPUTS, EvidenceNetwork
from detect.registered.features import FEATURES
from detect.synthesis.dataset import SCHEMA as SAMPLES_SCHEMA
from detect.synthesis.dataset import Shard, read_index
from detect.synthesis.recipe import Recipe
from geometry.camera import Camera
from geometry.colmap_files import FILES as COLMAP_BINARIES
from geometry.named_poses import read_camera
from geometry.npz import save_arrays
from geometry.pose_files import read_poses, write_colmap_model, write_transforms_json, write_tum
from geometry.sfm.result import Reconstruction
from geometry.trajectory import FARTHEST, Trajectory
from locate.evaluation.truth import SceneTruth
from locate.export.table import map_table
from locate.map.plume import PlumeMap
from locate.pipeline.config import RunConfig
from locate.pipeline.detections import load_detections, load_response
from locate.pipeline.known_lengths import KnownDistance
from locate.pipeline.placement import Placement
from locate.pipeline.points import load_points, save_points
from locate.pipeline.run_folder import RunFolder
from locate.pipeline.stamp import Stamp
from locate.recording.images import read_grey
from locate.recording.index import KeyFrame, KeyFrames
from locate.recording.opening import open_recording
from locate.simulation.campaign import SCHEMA as CAMPAIGN_SCHEMA
from locate.simulation.campaign import Campaign
from locate.simulation.photo_set import PhotoSet
from locate.simulation.scene import Scene
from locate.survey.coverage import FlightCoverage
from locate.survey.flights import read_config
from locate.survey.model import Flight, Survey
from locate.survey.scoring import CampaignTruth
from tests.detect.onnx_files import convolution
from tests.geometry.test_pose_lists import VARIANTS
from tests.locate import recorded, survey_runs
from tests.locate.answers import orbit, plume, plume_map
from tests.locate.test_formats import write_raw

FRAMES = 4
CHANNELS = len(FEATURES)
KERNELS = {name: np.ones((count, CHANNELS, 3, 3)) for name, count in OUTPUTS.items()}
CAMERA = Camera.pinhole(64, 48, 60.0)
LENS = Camera(
    model="OPENCV", width=64, height=48, params=(60.0, 61.0, 31.5, 23.5, 0.01, 0.0, 0.001, 0.0)
)
EXAMPLES = Path(detect.__file__).parents[1] / "examples" / "scenes"
Structure = Literal["json", "yaml", "npz", "bytes"]


@dataclass(frozen=True)
class Reader:
    """A reader of one kind of file.

    Attributes:
        file: Name of the file that is damaged, in the folder.
        write: Writes it and what it needs beside it into a folder.
        read: Reads it, by its path.
        structure: What the file is made of; "bytes" is damaged as such only.
    """

    file: str
    write: Callable[[Path], object]
    read: Callable[[Path], object]
    structure: Structure = "bytes"


def texture(seed: int = 0, shape: tuple[int, int] = (48, 64)) -> np.ndarray:
    """A grey image of much detail."""
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def check_poses(found: Trajectory) -> None:
    """What every trajectory must be that a reader lets in."""
    assert np.isfinite(found.times_s).all()
    assert np.isfinite(found.rotations).all()
    assert (np.abs(found.translations) <= FARTHEST).all()
    turns = found.rotations @ np.swapaxes(found.rotations, 1, 2)
    assert np.allclose(turns, np.eye(3), atol=1e-2)
    check_camera(found.camera)


def check_camera(found: Camera) -> None:
    """What every camera must be that a reader lets in."""
    assert found.width > 0
    assert found.height > 0
    assert np.isfinite(found.params).all()
    assert np.isfinite(found.focal_px)


def _read_poses(path: Path) -> None:
    check_poses(read_poses(path, CAMERA))


def _read_own_camera(path: Path) -> None:
    check_poses(read_poses(path))


def _write_model(folder: Path) -> None:
    write_colmap_model(orbit(FRAMES), np.eye(3), folder)


def _write_model_text(folder: Path) -> None:
    _write_model(folder)
    pycolmap.Reconstruction(folder).write_text(folder)
    for name in COLMAP_BINARIES:
        (folder / name).unlink()


def _write_photo_set(folder: Path, name: str) -> None:
    _write_pictures(folder, "images")
    named = [f"images/{i}.png" for i in range(FRAMES)]
    if name == "transforms.json":
        write_transforms_json(orbit(FRAMES), folder / name, named)
        return
    for i in range(FRAMES):
        numbers = [60, 0, 31.5, 0, 60, 23.5, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1]
        text = " ".join(map(str, [*numbers, i, 0, 0, 64, 48]))
        (folder / f"{i}.png.camera").write_text(text)


def _write_pictures(folder: Path, name: str) -> None:
    (folder / name).mkdir()
    for i in range(FRAMES):
        cv2.imwrite(str(folder / name / f"{i}.png"), texture(i))


def _write_pages(folder: Path) -> None:
    cv2.imwritemulti(str(folder / "pages.tif"), [texture(i) for i in range(FRAMES)])


def _write_image(name: str) -> Callable[[Path], object]:
    return lambda folder: cv2.imwrite(str(folder / name), texture())


def _write_by_extra(suffix: str, folder: Path) -> None:
    if suffix == ".dng":
        write_raw(folder / "a.dng")
        return
    import pillow_heif

    samples = np.repeat(texture()[..., None], 3, 2)
    size = samples.shape[1::-1]
    pillow_heif.from_bytes(mode="RGB", size=size, data=samples.tobytes()).save(folder / "a.heic")


def _read_recording(path: Path) -> None:
    for frame in open_recording(path).frames():
        assert frame.image.dtype == np.uint8
        assert np.isfinite(frame.time_s)


def _read_map(path: Path) -> None:
    found = PlumeMap.load(path)
    map_table(found)
    found.limit_text()
    json.dumps(found.to_dict(), allow_nan=False)


def _write_map(folder: Path) -> None:
    place = survey_runs.FIELD
    flown = survey_runs.Flown(name="a", feet=np.array([[0.0, 0.0, 0.0], [5.0, 5.0, 0.0]]))
    survey_runs.answer(flown, place).save(folder / "map.json")


def _write_truth(folder: Path) -> None:
    content = orbit(FRAMES).to_dict() | {"schema": "locate.truth/1"}
    plumes = [{"source": [0.0, 0.0, 0.1], "axis": [0.0, 0.1, 1.0]}]
    (folder / "truth.json").write_text(json.dumps(content | {"plumes": plumes}))
    (folder / "truth").mkdir()
    save_arrays(
        folder / "truth" / "000000.npz",
        displacement=np.zeros((6, 8, 2), np.float16),
        mask=np.zeros((6, 8), np.uint8),
    )


def _read_truth(path: Path) -> None:
    truth = SceneTruth.load(path.parent)
    assert np.isfinite(truth.ranges).all()
    assert np.isfinite(truth.axes).all()


def _write_reconstruction(folder: Path) -> None:
    Reconstruction(
        trajectory=orbit(FRAMES),
        names=tuple(f"{i}.png" for i in range(FRAMES)),
        points_in_world=np.zeros((5, 3)),
        point_errors_px=np.zeros(5),
        visible=tuple(np.arange(3) for _ in range(FRAMES)),
        report={"points": 5},
    ).save(folder)


def _write_key_frames(folder: Path) -> None:
    frames = tuple(
        KeyFrame(index=i, time_s=i / 10, source=f"{i}.png", sharpness=1.0, motion_px=2.0)
        for i in range(FRAMES)
    )
    KeyFrames(frames=frames, width=64, height=48, is_video=True, static=False).save(
        folder / "index.json"
    )


def _read_key_frames(path: Path) -> None:
    found = KeyFrames.load(path)
    assert len(found.names) == len(found.indices) == len(found.times_s)
    assert np.isfinite(found.times_s).all()
    assert found.width > 0
    assert found.height > 0


def _detection() -> Detection:
    shape = (12, 16)
    return Detection(
        displacement=np.zeros((*shape, 2), np.float32),
        sigma_px=np.ones(shape, np.float32),
        llr=np.zeros(shape, np.float32),
        inverse_depth=np.ones(shape, np.float32),
    )


def _write_detections(folder: Path) -> None:
    _detection().save(folder / "000000.npz")
    response = {"ratios": [0.0, 1.0, 2.0], "llr": [-1.0, 0.0, 3.0]}
    content = {"detector": "registered", "indices": [0], "response": response}
    (folder / "index.json").write_text(json.dumps(content))


def _read_detections(path: Path) -> None:
    load_detections(path.parent)
    load_response(path.parent)


def _write_stamp(folder: Path) -> None:
    digest = {"size": 3, "sha256": "0" * 64}
    time = {"name": "poses", "wall_s": 1.0, "cpu_s": 2.0, "note": "a"}
    content = {"fingerprint": "f", "outputs": ["sfm"], "files": {"sfm/a": digest}, "time": time}
    (folder / "stamp.json").write_text(json.dumps(content))


def _read_stamp(path: Path) -> None:
    found = Stamp.load(path)
    if found is not None:
        found.find_damage(path.parent)


def _write_config(folder: Path) -> None:
    (folder / "a.mp4").write_bytes(b"no video")
    run = RunFolder(folder / "run")
    run.save_config(RunConfig(recording=folder / "a.mp4").to_plain())
    (folder / "run" / "config.yaml").rename(folder / "config.yaml")


def _write_survey(folder: Path) -> None:
    flown = survey_runs.Flown(name="a", feet=np.zeros((1, 3)))
    answer = survey_runs.answer(flown, survey_runs.FIELD).to_dict()
    flight = Flight(name="a", source=folder / "a.mp4", folder=folder, digest="0", map=answer)
    Survey(origin=survey_runs.FIELD.to_dict(), flights=(flight,)).save(folder / "survey.json")


def _read_survey(path: Path) -> None:
    found = Survey.load(path)
    assert found.frame is not None
    for flight in found.mapped:
        assert flight.plume_map is not None
        assert flight.georeference is not None


def _write_campaign_truth(folder: Path) -> None:
    campaign = Campaign.load(EXAMPLES / "campaign.yaml")
    campaign.save(folder / "campaign.yaml")
    column = {"on": True, "source": [1.0, 2.0, 0.0], "probability": 0.5}
    flights = [
        {"name": flight.name, "wind_mps": [1.0, 0.5], "columns": [column] * len(campaign.sites)}
        for flight in campaign.flights
    ]
    content = {
        "schema": CAMPAIGN_SCHEMA,
        "origin": survey_runs.FIELD.to_dict(),
        "flights": flights,
    }
    (folder / "truth.json").write_text(json.dumps(content))


def _write_network(folder: Path, **metadata: object) -> Path:
    return convolution(folder / "a.onnx", KERNELS, **metadata)


def _write_flow_network(folder: Path) -> None:
    convolution(folder / "flow.onnx", {"flow": np.ones((2, 2, 3, 3))})


def _write_metadata(folder: Path) -> None:
    scale = {"weights": [1.0, 0.5], "offset": -2.0, "prior": 0.1, "auroc": 0.9}
    calibration = {"scores": ["logit", "excess"], "classes": {"smooth": scale}}
    response = {"ratios": [0.0, 1.0, 2.0], "llr": [-1.0, 0.0, 3.0]}
    content = {"calibration": calibration, "response": response, "stride": 4, "receptive_px": 8}
    (folder / "metadata.json").write_text(json.dumps(content))


def _read_metadata(path: Path) -> None:
    try:
        metadata = json.loads(path.read_text())
    except ValueError:
        metadata = {"calibration": path.read_text(errors="replace")}
    if not isinstance(metadata, dict):
        metadata = {"calibration": metadata}
    try:
        written = _write_network(path.parent, **metadata)
    except UnicodeEncodeError:
        return
    network = EvidenceNetwork(written)
    network.read_response()
    network.read_calibration()
    network.network(np.ones((CHANNELS, 9, 10), np.float32))


def _shipped(name: str) -> Callable[[Path], object]:
    """A network of the package, whose beginning and end are damaged: its middle is numbers."""
    source = Path(detect.__file__).parent / name

    def write(folder: Path) -> None:
        (folder / source.name).write_bytes(source.read_bytes())

    return write


def _copy(source: Path, name: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_bytes(source.read_bytes())


def _write_json(name: str, content: Any) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(json.dumps(content))


def _write_text(name: str, content: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(content)


def _write_shard(folder: Path) -> None:
    Shard(
        images=np.zeros((2, 8, 8), np.uint8),
        displacements=np.zeros((2, 8, 8, 2), np.float16),
        masks=np.zeros((2, 8, 8), bool),
        families=np.zeros(2, np.uint8),
    ).save(folder / "shard.npz")


def _read_shard(path: Path) -> None:
    shard = Shard.load(path)
    for i in range(len(shard)):
        shard.sample_at(i)


def _write_clip(folder: Path) -> None:
    TrainingClip(
        inputs=np.zeros((2, 9, 8, 8), np.float16),
        displacements=np.zeros((2, 8, 8, 2), np.float16),
        surface=np.ones((2, 8, 8), bool),
        amplitude_px=0.5,
    ).save(folder / "lesson_000000.npz")


def _write_coverage(folder: Path) -> None:
    layer = np.zeros((3, 4), np.float32)
    FlightCoverage(low=np.zeros(2, np.int64), limit_px=layer, seen_px=layer, key="k").save(
        folder / "a.npz"
    )


def _distance() -> dict[str, Any]:
    clicks = {"000000.png": [1.0, 2.0], "000002.png": [3.0, 4.0]}
    return {"distance_m": 1.5, "sigma_m": 0.1, "points": {"left": clicks, "right": clicks}}


READERS: dict[str, Reader] = {
    "trajectory": Reader(
        "trajectory.json",
        lambda folder: replace(
            orbit(FRAMES), covariances=np.tile(np.eye(6) * 1e-4, (FRAMES, 1, 1))
        ).save(folder / "trajectory.json"),
        _read_own_camera,
        "json",
    ),
    "transforms": Reader(
        "transforms.json",
        lambda folder: write_transforms_json(
            replace(orbit(FRAMES), camera=LENS), folder / "transforms.json"
        ),
        _read_own_camera,
        "json",
    ),
    "tum": Reader(
        "poses.txt", lambda folder: write_tum(orbit(FRAMES), folder / "poses.txt"), _read_poses
    ),
    **{
        kind: Reader("poses.txt", _write_text("poses.txt", VARIANTS[kind]), _read_poses)
        for kind in ("EuRoC with velocities", "KITTI")
    },
    **{
        f"colmap {name}": Reader(name, _write_model, lambda path: _read_own_camera(path.parent))
        for name in COLMAP_BINARIES
    },
    **{
        f"colmap {name}": Reader(
            name, _write_model_text, lambda path: _read_own_camera(path.parent)
        )
        for name in (Path(binary).with_suffix(".txt").name for binary in COLMAP_BINARIES)
    },
    "camera": Reader(
        "camera.json",
        _write_json("camera.json", {"camera": LENS.to_dict()}),
        lambda path: check_camera(read_camera(path, 64, 48)),
        "json",
    ),
    "distance": Reader(
        "distance.json", _write_json("distance.json", _distance()), KnownDistance.load, "json"
    ),
    "map": Reader("map.json", _write_map, _read_map, "json"),
    "map without place": Reader(
        "map.json", lambda folder: plume_map(plume()).save(folder / "map.json"), _read_map, "json"
    ),
    "truth": Reader("truth.json", _write_truth, _read_truth, "json"),
    "truth of a frame": Reader(
        "truth/000000.npz",
        _write_truth,
        lambda path: SceneTruth.load(path.parents[1]).frame(0),
        "npz",
    ),
    "detection": Reader(
        "000000.npz", lambda folder: _detection().save(folder / "000000.npz"), Detection.load, "npz"
    ),
    "index of detections": Reader("index.json", _write_detections, _read_detections, "json"),
    "points": Reader(
        "points.npz",
        lambda folder: save_points(folder / "points.npz", np.ones((3, 3))),
        load_points,
        "npz",
    ),
    "points of a reconstruction": Reader(
        "points.npz", _write_reconstruction, lambda path: Reconstruction.load(path.parent), "npz"
    ),
    "report of a reconstruction": Reader(
        "report.json", _write_reconstruction, lambda path: Reconstruction.load(path.parent), "json"
    ),
    "key frames": Reader("index.json", _write_key_frames, _read_key_frames, "json"),
    "placement": Reader(
        "place.json",
        lambda folder: Placement(georeference=survey_runs.FIELD, notes=("a",)).save(
            folder / "place.json"
        ),
        Placement.load,
        "json",
    ),
    "stamp": Reader("stamp.json", _write_stamp, _read_stamp, "json"),
    "run config": Reader(
        "config.yaml", _write_config, lambda path: read_config(path.parent), "yaml"
    ),
    "scene": Reader(
        "scene.yaml", _copy(EXAMPLES / "pipe_rack_leak.yaml", "scene.yaml"), Scene.load, "yaml"
    ),
    "campaign": Reader(
        "campaign.yaml", _copy(EXAMPLES / "campaign.yaml", "campaign.yaml"), Campaign.load, "yaml"
    ),
    "recipe": Reader(
        "recipe.yaml",
        lambda folder: (folder / "recipe.yaml").write_text(
            next((Path(detect.__file__).parent / "dybs/training/recipes").iterdir()).read_text()
        ),
        Recipe.load,
        "yaml",
    ),
    "training config": Reader(
        "registered.yaml",
        _shipped("registered/training/registered.yaml"),
        TrainConfig.load,
        "yaml",
    ),
    "survey": Reader("survey.json", _write_survey, _read_survey, "json"),
    "truth of a campaign": Reader(
        "truth.json",
        _write_campaign_truth,
        lambda path: CampaignTruth.load(path.parent, survey_runs.FIELD),
        "json",
    ),
    "coverage": Reader("a.npz", _write_coverage, FlightCoverage.load, "npz"),
    "training clip": Reader("lesson_000000.npz", _write_clip, TrainingClip.load, "npz"),
    "shard": Reader("shard.npz", _write_shard, _read_shard, "npz"),
    "index of samples": Reader(
        "dataset.json",
        _write_json("dataset.json", {"schema": SAMPLES_SCHEMA, "count": 2}),
        lambda path: read_index(path.parent),
        "json",
    ),
    "posed photos": Reader(
        "transforms.json",
        lambda folder: _write_photo_set(folder, "transforms.json"),
        lambda path: PhotoSet.load(path.parent).read_image(0),
        "json",
    ),
    "strecha": Reader(
        "1.png.camera",
        lambda folder: _write_photo_set(folder, "strecha"),
        lambda path: check_poses(PhotoSet.load(path.parent).trajectory),
    ),
    **{
        name: Reader(f"a{name}", _write_image(f"a{name}"), read_grey)
        for name in (".png", ".jpg", ".tif", ".webp", ".bmp", ".pgm", ".jp2")
    },
    **{
        f"a{suffix}": Reader(f"a{suffix}", partial(_write_by_extra, suffix), read_grey)
        for suffix, module in ((".heic", "pi_heif"), (".dng", "rawpy"))
        if find_spec(module)
    },
    "pages": Reader("pages.tif", _write_pages, _read_recording),
    "folder of photos": Reader(
        "photos/1.png",
        lambda folder: _write_pictures(folder, "photos"),
        lambda path: _read_recording(path.parent),
    ),
    **{
        name: Reader(
            name,
            lambda folder, name=name, codec=codec: recorded.write_video(
                folder / name, codec, recorded.SRT.split("\n\n")
            ),
            _read_recording,
        )
        for name, codec in (("a.mp4", "mov_text"), ("a.mkv", "subrip"))
    },
    "network": Reader("a.onnx", _write_network, Network),
    "metadata of a network": Reader("metadata.json", _write_metadata, _read_metadata, "json"),
    "flow network": Reader("flow.onnx", _write_flow_network, OnnxFlow),
    "dybs": Reader("lite-fast.onnx", _shipped("dybs/weights/lite-fast.onnx"), DybsDetector),
}
