import datetime as dt
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from geometry.errors import BadInputError
from geometry.georeference import Georeference
from geometry.georeference.gravity import up_from_gimbal
from locate.commands.app import app
from locate.evaluation.truth import SceneTruth
from locate.simulation import Campaign, Scene, simulate_campaign
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.campaign import FlightPlan, ThermalSite
from locate.simulation.subtitles import GpsReceiver, attitude_deg, write_subtitles
from locate.telemetry import read_telemetry

PERFECT = {"white_m": 0, "wander_m": 0, "outliers": 0, "gimbal_deg": 0}
CAMPAIGN = {
    "kind": "campaign",
    "seed": 4,
    "origin": {"lat_deg": -33.9, "lon_deg": 151.2, "height_m": 40},
    "camera": {"width": 64, "height": 48, "focal_px": 60},
    "video": {"frames": 3, "fps": 2},
    "image": {"samples": 1},
    "receiver": PERFECT,
    "wind_mps": [0.5, -0.2],
    "wind_sigma_mps": 0.1,
    "objects": [{"kind": "ground", "material": "field", "extent_m": 200}],
    "sites": [
        {"name": "roof", "position": [2, 20, 3], "occurrence": {12: 1.0}, "drift_s": 3},
        {"name": "never", "position": [9, 20, 3], "occurrence": {0: 0.0}},
    ],
    "flights": [
        {"name": name, "start": f"2026-06-20T{hour:02d}:30:00",
         "path": {"kind": "orbit", "target": [0, 20, 8], "radius_m": 40, "height_m": 30}}
        for name, hour in (("a", 10), ("b", 15))
    ],
}  # fmt: skip


def campaign(**changes) -> Campaign:
    return Campaign.model_validate(CAMPAIGN | changes)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    simulate_campaign(campaign(), folder)
    return folder


def test_our_own_reader_finds_the_cameras_in_the_subtitles(rendered):
    truth = json.loads((rendered / "truth.json").read_text())
    place = Georeference.from_dict(truth["origin"])
    for flight in truth["flights"]:
        cameras = SceneTruth.load(rendered / flight["truth"]).trajectory
        track = read_telemetry(rendered / flight["telemetry"])
        assert track.kind == "DJI SRT"
        assert track.times_s == pytest.approx(cameras.times_s)
        written = np.stack([track.latitude_deg, track.longitude_deg, track.altitude_m], axis=1)
        assert place.to_enu(written) == pytest.approx(cameras.centers_in_world, abs=0.02)
        assert track.height_m == pytest.approx(cameras.centers_in_world[:, 2], abs=0.01)
        start = dt.datetime.fromisoformat(flight["start_local"]).replace(tzinfo=dt.UTC)
        assert track.clock_s[0] == pytest.approx(start.timestamp())
        assert start.hour + 0.5 == flight["local_hour"]


def test_truth_says_which_column_stood_where(rendered):
    truth = json.loads((rendered / "truth.json").read_text())
    place = Georeference.from_dict(truth["origin"])
    for flight in truth["flights"]:
        roof, never = flight["columns"]
        assert (roof["on"], never["on"], never["source"]) == (True, False, None)
        drifted = np.array([2, 20, 3]) + 3 * np.array([*flight["wind_mps"], 0])
        assert roof["source"] == pytest.approx(drifted)
        assert place.to_enu(roof["lat_lon_height"])[0] == pytest.approx(drifted, abs=1e-4)
        assert SceneTruth.load(rendered / flight["truth"]).sources == pytest.approx(drifted[None])


def test_a_flight_more_leaves_the_others_alone(rendered):
    before = {path: path.stat().st_mtime_ns for path in (rendered / "videos").iterdir()}
    more = campaign(flights=[*CAMPAIGN["flights"], CAMPAIGN["flights"][0] | {"name": "c"}])
    simulate_campaign(more, rendered)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert (rendered / "videos" / "c.mkv").exists()
    assert len(json.loads((rendered / "truth.json").read_text())["flights"]) == 3
    with pytest.raises(BadInputError, match="holds another campaign"):
        simulate_campaign(campaign(seed=5), rendered)


def test_attitude_is_what_the_gimbal_constraint_expects():
    path = CAMPAIGN["flights"][0]["path"] | {"jitter_deg": 12.0, "jitter_m": 0.5}
    scene = Scene.model_validate({"video": {"frames": 30}, "path": path})
    cameras = simulate_trajectory(scene)
    yaw, pitch, roll = attitude_deg(cameras.rotations).T
    up = up_from_gimbal(cameras, pitch, roll)
    assert up.up_in_source == pytest.approx([0, 0, 1], abs=1e-9)
    heading = np.degrees(np.arctan2(*cameras.rotations[:, 2, :2].T))
    assert np.cos(np.radians(yaw - heading)) == pytest.approx(1)
    assert np.ptp(roll) > 5


def test_straight_down_has_no_roll():
    down = np.array([[[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]])
    assert attitude_deg(down)[0] == pytest.approx([0, -90, 0])


def test_receiver_errs_as_it_says():
    receiver = GpsReceiver(white_m=0.3, wander_m=0.4, wander_s=5, outliers=0.1, outlier_m=30)
    times, rng = np.arange(20_000) * 0.5, np.random.default_rng(0)
    errors = receiver.simulate_fixes(times, np.zeros((len(times), 3)), rng)
    wrong = np.abs(errors[:, :2]).max(axis=1) > 3
    assert 0.08 < wrong.mean() < 0.1
    good = errors[np.abs(errors).max(axis=1) < 4]
    assert good[:, 0].std() == pytest.approx(0.5, rel=0.08)
    assert good[:, 2].std() == pytest.approx(0.8, rel=0.08)
    step = np.diff(errors[:, 0])
    assert np.median(np.abs(step)) < 0.6745 * np.sqrt(2) * 0.5


def test_columns_stand_as_often_as_they_should():
    site = {"name": "s", "position": [0, 0, 0], "occurrence": {10: 0.2, 14: 0.8}, "wander_m": 2.0}
    start = CAMPAIGN["flights"][0] | {"start": "2026-06-20T13:00:00"}
    flights = [start | {"name": f"f{number}"} for number in range(600)]
    made = campaign(sites=[site], flights=flights, wind_mps=[0, 0])
    feet = [made.columns_of(number).get("s") for number in range(600)]
    assert ThermalSite.model_validate(site).probability_at(13.0) == pytest.approx(0.65)
    assert np.mean([foot is not None for foot in feet]) == pytest.approx(0.65, abs=0.06)
    assert np.std([foot[0] for foot in feet if foot]) == pytest.approx(2.0, rel=0.15)
    assert campaign(sites=[site], flights=flights[:9]).columns_of(8) == made.columns_of(8)


def test_command(tmp_path):
    made = campaign(flights=CAMPAIGN["flights"][:1], video={"frames": 1}, sites=[])
    made.save(tmp_path / "c.yaml")
    assert Campaign.load(tmp_path / "c.yaml") == made
    run = CliRunner().invoke(app, ["simulate", str(tmp_path / "c.yaml"), "-o", str(tmp_path / "o")])
    assert run.exit_code == 0, run.output
    assert (tmp_path / "o" / "videos" / "a.srt").exists()
    assert json.loads((tmp_path / "o" / "camera.json").read_text())["camera"]["width"] == 64


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"flights": [CAMPAIGN["flights"][0]] * 2}, "two flights have one name"),
        ({"sites": [{"name": "x", "position": [0, 0, 0], "occurrence": {9: 1.5}}]}, "occurrence"),
        ({"flights": []}, "flights"),
        ({"wind": [0, 0]}, "wind"),
    ],
)
def test_a_wrong_campaign_is_named(tmp_path, change, line):
    path = tmp_path / "c.yaml"
    path.write_text(json.dumps(CAMPAIGN | change))
    with pytest.raises(BadInputError, match=line):
        Campaign.load(path)


def test_a_flight_is_named_like_a_file():
    with pytest.raises(ValueError, match="pattern"):
        FlightPlan.model_validate(CAMPAIGN["flights"][0] | {"name": "../a"})


def test_subtitles_without_a_gimbal(tmp_path):
    made = campaign(receiver=PERFECT | {"gimbal_deg": None})
    write_subtitles(
        tmp_path / "a.srt",
        simulate_trajectory(made.scene_of(0)),
        made.origin.build(),
        made.receiver,
        start=made.flights[0].start,
        rng=np.random.default_rng(0),
    )
    assert np.isnan(read_telemetry(tmp_path / "a.srt").gimbal_pitch_deg).all()
