"""Finished run folders of flights that never took place, as `locate run` leaves them."""

import json
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from detect.detection import Detection
from geometry.arrays import FloatArray
from geometry.camera import Camera
from geometry.georeference import Alignment, Georeference, HeightDatum
from geometry.georeference.constraints import point_jacobian
from geometry.grid import EvidenceGrid, VoxelBox
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory
from locate.map.georeferenced import georeference_map
from locate.map.plume import PlumeMap
from locate.pipeline.config import RunConfig
from locate.pipeline.evidence import save_evidence
from locate.pipeline.run_folder import RunFolder
from tests.locate.answers import plume, plume_map

FIELD = Georeference(
    lat_deg=47.0, lon_deg=8.0, height_m=500.0, datum=HeightDatum.MEAN_SEA_LEVEL, name="field"
)
OWN_SIGMA_M = 0.3
OFFSET_SIGMAS = np.array([0.002, 0.002, 0.004, 1.0, 1.0, 2.0, 0.002])
HEIGHT_M, SIGMA_PX, THRESHOLD_NATS = 40.0, 0.05, 20.0
NADIR = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, kw_only=True)
class Flown:
    """A flight to make up.

    Attributes:
        name: Of its folder.
        start: Local time.
        feet: (N, 3) of the columns that stand, east, north, up in `FIELD`.
        lean: Metres per metre of rise, of every column.
        seed: Of the errors; None for none.
        take_off: East and north of its own origin in `FIELD`.
        sigma_px: Of its displacements.
    """

    name: str
    start: datetime = datetime(2026, 7, 1, 12, 0)
    feet: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    lean: tuple[float, float] = (0.0, 0.0)
    seed: int | None = None
    take_off: tuple[float, float] = (30.0, -20.0)
    sigma_px: float = SIGMA_PX


def write_run(root: Path, flown: Flown) -> Path:
    """The folder of a run: config, map, cameras, detections and the recording's subtitles."""
    folder = root / flown.name
    video = root / f"{flown.name}.mp4"
    video.write_bytes(b"no video")
    _write_subtitles(video.with_suffix(".srt"), flown)
    RunFolder(folder).save_config(RunConfig(recording=video).to_plain())
    origin = FIELD.lat_lon_height([[*flown.take_off, 0.0]])[0]
    place = replace(
        FIELD, lat_deg=origin[0], lon_deg=origin[1], height_m=origin[2], name="first fix"
    )
    answer(flown, place).save(folder / "map.json")
    trajectory = over_the_field(flown, place)
    trajectory.save(folder / "trajectory.json")
    _write_detections(folder, trajectory, flown.sigma_px)
    return folder


def answer(flown: Flown, place: Georeference) -> PlumeMap:
    """What the flight says it saw: its offset in all of it, its own error in each."""
    rng = np.random.default_rng(flown.seed or 0)
    errs = 0.0 if flown.seed is None else 1.0
    true = place.to_enu(FIELD.lat_lon_height(flown.feet))
    offset = errs * OFFSET_SIGMAS * rng.normal(size=7)
    own = errs * OWN_SIGMA_M * rng.normal(size=true.shape)
    said = true + point_jacobian(true) @ offset + own
    axis = np.array([*flown.lean, 1.0])
    plumes = [
        plume(
            source,
            id=number,
            source_covariance=OWN_SIGMA_M**2 * np.eye(3),
            axis=axis / np.linalg.norm(axis),
            extent_high=12.0,
            radius_by_height=np.array([[0.0, 0.5], [6.0, 0.6], [12.0, 0.7]]),
        )
        for number, source in enumerate(said, start=1)
    ]
    alignment = Alignment(
        target_from_source=Similarity(scale=1.0, rotation=np.eye(3), translation=np.zeros(3)),
        covariance=np.diag(OFFSET_SIGMAS**2),
        metric=True,
        gravity=True,
        located=True,
        sources=(),
    )
    return georeference_map(plume_map(*plumes), alignment, place)


def over_the_field(flown: Flown, place: Georeference, frames: int = 10) -> Trajectory:
    """Straight north over the middle of `FIELD`, looking down."""
    north = np.linspace(-36, 36, frames)
    centers = np.column_stack([np.zeros(frames), north, np.full(frames, HEIGHT_M)])
    in_flight = place.to_enu(FIELD.lat_lon_height(centers))
    return Trajectory(
        camera=Camera.pinhole(64, 48, 60.0),
        indices=np.arange(frames),
        times_s=np.arange(frames, dtype=float),
        rotations=np.tile(NADIR, (frames, 1, 1)),
        translations=-in_flight @ NADIR.T,
        metric=True,
        gravity=True,
    )


def _write_detections(folder: Path, trajectory: Trajectory, sigma_px: float) -> None:
    shape = (48, 64)
    (folder / "detections").mkdir()
    for index, height in zip(trajectory.indices, trajectory.centers_in_world[:, 2], strict=True):
        Detection(
            displacement=np.zeros((*shape, 2), np.float32),
            sigma_px=np.full(shape, sigma_px, np.float32),
            llr=np.full(shape, -0.1, np.float32),
            inverse_depth=np.full(shape, 1 / height, np.float32),
        ).save(folder / "detections" / f"{index:06d}.npz")
    index_file = {"detector": "registered", "indices": trajectory.indices.tolist()}
    (folder / "detections" / "index.json").write_text(json.dumps(index_file))
    box = VoxelBox(low_in_world=np.zeros(3), voxel=1.0, shape=(1, 1, 1))
    nothing = np.zeros(box.shape, np.float32)
    grid = EvidenceGrid(box=box, llr=nothing, weight=nothing)
    save_evidence(grid, THRESHOLD_NATS, folder / "evidence.npz")


def _write_subtitles(path: Path, flown: Flown) -> None:
    cues = [
        f"{i + 1}\n00:00:{i:02d},000 --> 00:00:{i + 1:02d},000\n"
        f"{flown.start + timedelta(seconds=i):%Y-%m-%d %H:%M:%S}.000\n"
        "[latitude: 47.000000] [longitude: 8.000000] [rel_alt: 40.0 abs_alt: 540.0]\n"
        for i in range(10)
    ]
    path.write_text("\n".join(cues))
