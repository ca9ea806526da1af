import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.errors import BadInputError
from geometry.georeference import Georeference, HeightDatum
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory
from locate.pipeline.config import RunConfig
from locate.pipeline.files import RunFiles
from locate.pipeline.guessed_up import load_up_source
from locate.pipeline.known_lengths import KnownLengths
from locate.pipeline.place import place_reconstruction, place_run
from locate.pipeline.placement import Placement
from locate.pipeline.source import RecordingSource
from locate.recording.index import KeyFrame, KeyFrames
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.scene import PathBlock, Scene, VideoBlock
from locate.telemetry import telemetry_candidates
from tests.locate import recorded

ORIGIN = Georeference(lat_deg=47.2, lon_deg=8.5, height_m=450.0, datum=HeightDatum.MEAN_SEA_LEVEL)
GPS_SIGMA_M = 0.5
TURN = Rotation.from_rotvec([0.4, -0.2, 1.1]).as_matrix()


@pytest.fixture(scope="module")
def flight() -> Trajectory:
    """The true cameras of a wide orbit, east-north-up."""
    path = PathBlock(kind="orbit", radius_m=40, height_m=20, arc_deg=150, jitter_m=0.3)
    return simulate_trajectory(Scene(path=path, video=VideoBlock(frames=40, fps=2)))


def reconstructed(flight: Trajectory) -> Trajectory:
    """As structure from motion gives it: any scale, any up."""
    scrambled = Similarity(scale=0.07, rotation=TURN, translation=np.array([3.0, 2, 1]))
    return replace(flight.transformed(scrambled), metric=False, gravity=False)


def frames_of(flight: Trajectory, *, video: bool) -> KeyFrames:
    return KeyFrames(
        frames=tuple(
            KeyFrame(
                index=int(i), time_s=float(t), source=f"P{i:03d}.JPG", sharpness=1.0, motion_px=5.0
            )
            for i, t in zip(flight.indices, flight.times_s, strict=True)
        ),
        width=640, height=480, is_video=video, static=False, focal_prior_px=None,
    )  # fmt: skip


def write_csv(path: Path, flight: Trajectory, seed: int = 0) -> Path:
    rng = np.random.default_rng(seed)
    noisy = flight.centers_in_world + rng.normal(0, GPS_SIGMA_M, (len(flight), 3))
    rows = [
        f"P{i:03d}.JPG,{lat:.9f},{lon:.9f},{height:.3f}"
        for i, (lat, lon, height) in enumerate(ORIGIN.lat_lon_height(noisy))
    ]
    path.write_text("\n".join(["filename,latitude,longitude,altitude", *rows]) + "\n")
    return path


def test_photos_with_gps_are_placed_on_the_earth(flight: Trajectory, tmp_path: Path) -> None:
    source = reconstructed(flight)
    telemetry = write_csv(tmp_path / "gps.csv", flight)
    placement = place_reconstruction(
        source, frames_of(flight, video=False), [telemetry], asked=True
    )
    moved = placement.apply(source)
    assert (moved.metric, moved.gravity) == (True, True)
    assert placement.georeference is not None
    there = placement.georeference.lat_lon_height(moved.centers_in_world)
    error_m = np.linalg.norm(ORIGIN.to_enu(there) - flight.centers_in_world, axis=1)
    assert error_m.max() < 1.0
    np.testing.assert_allclose(
        np.ptp(moved.centers_in_world, axis=0), np.ptp(flight.centers_in_world, axis=0), atol=1.0
    )


def test_positions_that_contradict_the_images_are_counted(
    flight: Trajectory, tmp_path: Path
) -> None:
    wrong = flight.centers_in_world.copy()
    wrong[[7, 30]] += [60.0, -40.0, 0.0]
    rows = [
        f"P{i:03d}.JPG,{lat:.9f},{lon:.9f},{height:.3f}"
        for i, (lat, lon, height) in enumerate(ORIGIN.lat_lon_height(wrong))
    ]
    path = tmp_path / "gps.csv"
    path.write_text("\n".join(["filename,latitude,longitude,altitude", *rows]) + "\n")
    frames = frames_of(flight, video=False)
    (note,) = place_reconstruction(reconstructed(flight), frames, [path], asked=True).notes
    assert note.startswith("gps.csv: 2 of 40 positions contradict the path that the images show")


def test_photos_are_placed_by_a_gpx_beside_them(flight: Trajectory, tmp_path: Path) -> None:
    whole_seconds = flight.take(np.arange(0, len(flight), 2))
    begin = datetime(2024, 5, 1, 12, 0, 0, tzinfo=UTC)
    places = ORIGIN.lat_lon_height(whole_seconds.centers_in_world)
    points = ""
    for (lat, lon, height), t in zip(places, whole_seconds.times_s, strict=True):
        moment = begin + timedelta(seconds=float(t))
        points += f'<trkpt lat="{lat:.9f}" lon="{lon:.9f}"><ele>{height:.3f}</ele>'
        points += f"<time>{moment:%Y-%m-%dT%H:%M:%SZ}</time></trkpt>"
    for index, t in zip(whole_seconds.indices, whole_seconds.times_s, strict=True):
        local = begin + timedelta(hours=2, seconds=float(t))
        exif = {0x9003: f"{local:%Y:%m:%d %H:%M:%S}"}
        recorded.write_photo(tmp_path / f"P{index:03d}.JPG", exif=exif)
    head = '<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">'
    (tmp_path / "walk.gpx").write_text(f"{head}<trk><trkseg>{points}</trkseg></trk></gpx>")
    source = reconstructed(whole_seconds)
    placement = place_reconstruction(
        source, frames_of(flight, video=False), telemetry_candidates(tmp_path), photos=tmp_path
    )
    assert placement.georeference is not None
    there = placement.georeference.lat_lon_height(placement.apply(source).centers_in_world)
    error_m = np.linalg.norm(ORIGIN.to_enu(there) - whole_seconds.centers_in_world, axis=1)
    assert error_m.max() < 0.1
    assert "walk.gpx: its positions were given to the photos by their times" in placement.notes[-1]


def test_a_placement_is_read_back(flight: Trajectory, tmp_path: Path) -> None:
    source = reconstructed(flight)
    telemetry = write_csv(tmp_path / "gps.csv", flight)
    placement = place_reconstruction(source, frames_of(flight, video=False), [telemetry])
    placement.save(tmp_path / "placement.json")
    again = Placement.load(tmp_path / "placement.json")
    np.testing.assert_allclose(
        again.apply(source).centers_in_world, placement.apply(source).centers_in_world
    )
    assert again.georeference == placement.georeference
    assert "metric, gravity, located by gps.csv" in again.describe()


def test_what_was_found_and_cannot_be_used_is_noted(flight: Trajectory, tmp_path: Path) -> None:
    source, frames = reconstructed(flight), frames_of(flight, video=False)
    telemetry = write_csv(tmp_path / "gps.csv", flight.take(np.arange(2)))
    placement = place_reconstruction(source, frames, [tmp_path / "folder", telemetry])
    assert placement.alignment is None
    np.testing.assert_array_equal(placement.apply(source).translations, source.translations)
    (note,) = placement.notes
    assert "gps.csv" in note
    with pytest.raises(BadInputError, match=r"gps\.csv"):
        place_reconstruction(source, frames, [telemetry], asked=True)


def test_positions_of_no_known_form_are_noted(flight: Trajectory, tmp_path: Path) -> None:
    source, frames = reconstructed(flight), frames_of(flight, video=False)
    refused = tmp_path / "refused.csv"
    refused.write_text("filename,latitude,longitude\nP000.JPG,4807.038,1131.000\n")
    telemetry = write_csv(tmp_path / "gps.csv", flight)
    for files in ([refused], [refused, telemetry]):
        placement = place_reconstruction(source, frames, files)
        assert placement.notes[0].startswith(f"Telemetry left out: {refused}, line 2: ")
        assert (placement.georeference is None) == (len(files) == 1)


def test_a_known_camera_height_sets_the_scale(flight: Trajectory) -> None:
    rng = np.random.default_rng(1)
    ground = np.c_[rng.uniform(-60, 60, (400, 2)), rng.normal(0, 0.02, 400)]
    to_source = Similarity(scale=0.07, rotation=np.eye(3), translation=np.zeros(3))
    source = replace(flight.transformed(to_source), metric=False, gravity=False)
    placement = place_reconstruction(
        source, frames_of(flight, video=True), [], camera_height_m=20.0,
        points_in_world=to_source(ground),
    )  # fmt: skip
    moved = placement.apply(source)
    assert moved.metric
    assert np.ptp(moved.centers_in_world[:, 0]) == pytest.approx(
        np.ptp(flight.centers_in_world[:, 0]), rel=0.02
    )
    with pytest.raises(BadInputError, match="needs a reconstruction"):
        place_reconstruction(source, frames_of(flight, video=True), [], camera_height_m=20.0)


def timed_csv(path: Path, flight: Trajectory, offset_s: float) -> Path:
    """A log whose time is the flight's plus an offset."""
    rows = [
        f"{t + offset_s:.3f},{lat:.9f},{lon:.9f},{height:.3f}"
        for t, (lat, lon, height) in zip(
            flight.times_s, ORIGIN.lat_lon_height(flight.centers_in_world), strict=True
        )
    ]
    path.write_text("\n".join(["time (s),latitude,longitude,altitude", *rows]) + "\n")
    return path


def test_a_stated_offset_is_used_instead_of_an_estimate(flight: Trajectory, tmp_path: Path) -> None:
    """The video's second 1 is second 100 of the log."""
    early = replace(flight, times_s=flight.times_s + 1.0)
    log = timed_csv(tmp_path / "log.csv", flight, 100.0)
    frames = frames_of(early, video=True)
    placed = place_reconstruction(reconstructed(early), frames, [log], asked=True, offset_s=99.0)
    found = placed.apply(reconstructed(early))
    distances = np.linalg.norm(np.diff(found.centers_in_world, axis=0), axis=1)
    true = np.linalg.norm(np.diff(flight.centers_in_world, axis=0), axis=1)
    assert distances.sum() == pytest.approx(true.sum(), rel=0.01)
    assert placed.notes == ()


def test_an_offset_of_what_has_no_times_is_refused(flight: Trajectory, tmp_path: Path) -> None:
    photos = write_csv(tmp_path / "geo.csv", flight)
    for telemetry, reason in (([photos], "have no times"), ([], "no telemetry can be used")):
        with pytest.raises(BadInputError, match=reason):
            place_reconstruction(
                reconstructed(flight), frames_of(flight, video=True), telemetry, asked=True,
                offset_s=1.0,
            )  # fmt: skip


def test_positions_without_heights_place_a_map_horizontally(
    flight: Trajectory, tmp_path: Path
) -> None:
    rows = [
        f"P{i:03d}.JPG,{lat:.9f},{lon:.9f}"
        for i, (lat, lon, _) in enumerate(ORIGIN.lat_lon_height(flight.centers_in_world))
    ]
    path = tmp_path / "flat.csv"
    path.write_text("\n".join(["filename,latitude,longitude", *rows]) + "\n")
    rng = np.random.default_rng(1)
    ground = np.c_[rng.uniform(-60, 60, (400, 2)), rng.normal(0, 0.02, 400)]
    to_source = Similarity(scale=0.07, rotation=np.eye(3), translation=np.zeros(3))
    source = replace(flight.transformed(to_source), metric=False, gravity=False)
    placed = place_reconstruction(
        source, frames_of(flight, video=False), [path], asked=True,
        points_in_world=to_source(ground),
    )  # fmt: skip
    found = placed.apply(source).centers_in_world
    true = flight.centers_in_world - flight.centers_in_world[0]
    np.testing.assert_allclose(found - found[0], true, atol=1.0)
    assert abs(found[0, 2]) < 0.5
    assert placed.georeference is not None
    assert placed.georeference.datum is HeightDatum.UNKNOWN
    assert any("holds no heights" in note for note in placed.notes)
    with pytest.raises(BadInputError, match="no frame has a position with a height"):
        place_reconstruction(source, frames_of(flight, video=False), [path], asked=True)


@pytest.mark.parametrize(
    ("up_from", "gravity", "said"),
    [
        ("plane", False, "Up is a guess: the plane that most points lie on"),
        ("level", False, "Up is a guess: the cameras are taken for held level"),
        ("camera", False, "Up is a guess: the mean of the cameras' own up"),
        (None, False, "Up is the z axis of the given poses"),
        (None, True, None),
    ],
)
def test_the_map_says_from_what_up_was_guessed(
    flight: Trajectory, tmp_path: Path, up_from: str | None, gravity: bool, said: str | None
) -> None:
    files = RunFiles(tmp_path)
    files.sfm.mkdir()
    replace(reconstructed(flight), gravity=gravity).save(files.sfm_trajectory)
    if up_from is not None:
        files.sfm_report.write_text(json.dumps({"report": {"up_from": up_from}}))
    source = RecordingSource(config=RunConfig(recording=tmp_path), bag=None)
    key_frames = frames_of(flight, video=True)
    place_run(source, key_frames, KnownLengths.of(None, None), files, files)
    notes = Placement.load(files.placement).notes
    assert len(notes) == (said is not None)
    for note in notes:
        assert note.startswith(str(said))
        assert "--telemetry" in note


def test_a_telemetry_that_tells_up_leaves_nothing_to_say_of_it(
    flight: Trajectory, tmp_path: Path
) -> None:
    files = RunFiles(tmp_path)
    files.sfm.mkdir()
    reconstructed(flight).save(files.sfm_trajectory)
    telemetry = write_csv(tmp_path / "gps.csv", flight)
    config = RunConfig(recording=tmp_path, telemetry=telemetry)
    source = RecordingSource(config=config, bag=None)
    key_frames = frames_of(flight, video=False)
    place_run(source, key_frames, KnownLengths.of(None, None), files, files)
    assert not [note for note in Placement.load(files.placement).notes if note.startswith("Up")]


@pytest.mark.parametrize("content", ["[]", '{"report": {}}', '{"report": {"up_from": "sky"}}'])
def test_a_damaged_report_of_a_reconstruction_is_named(tmp_path: Path, content: str) -> None:
    files = RunFiles(tmp_path)
    files.sfm.mkdir()
    files.sfm_report.write_text(content)
    with pytest.raises(BadInputError, match=r"report\.json"):
        load_up_source(files)
