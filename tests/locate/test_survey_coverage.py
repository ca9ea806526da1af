"""When a flight was, which way its columns lean, and which ground it covered."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from detect.response import Response
from geometry.errors import BadInputError
from locate.survey.cells import SightingPlace, count_cells, spread_over_cells
from locate.survey.coverage import CoverageJob, FlightCoverage, measure_coverage, views_of
from locate.survey.flights import FlightJob, RequestedFlight
from locate.survey.frame import offset_of, sightings_of
from locate.survey.model import Flight, FlightMoment, ReferenceColumn, SurveySettings
from locate.survey.moments import bin_of, moment_of_track
from locate.survey.wind import wind_of
from locate.telemetry import read_telemetry
from locate.telemetry.track import Clock, TelemetryTrack
from tests.locate.survey_runs import FIELD, Flown, write_run

CELL_M = 4.0
COLUMN = ReferenceColumn(radius_m=0.6, height_m=12.0)
SITE = np.array([[5.0, 10.0, 0.0]])


def flight(root: Path, flown: Flown) -> Flight:
    folder = write_run(root, flown)
    given = RequestedFlight(name=flown.name, source=folder, folder=folder)
    read = FlightJob(settings=SurveySettings())(given)
    assert read.failure is None
    return read


def track(root: Path, clock: Clock, moment: datetime, longitude_deg: float) -> TelemetryTrack:
    write_run(root, Flown(name="any"))
    read = read_telemetry(root / "any.srt")
    clock_s = np.full(len(read), moment.replace(tzinfo=UTC).timestamp())
    longitudes = np.full(len(read), longitude_deg)
    return replace(read, clock=clock, clock_s=clock_s, longitude_deg=longitudes)


@pytest.mark.parametrize(
    ("clock", "longitude_deg", "hour", "day"),
    [
        (Clock.UTC, 0.0, 22.5, 31),
        (Clock.UTC, 90.0, 4.5, 32),
        (Clock.UTC, -120.0, 14.5, 31),
        (Clock.LOCAL, 90.0, 22.5, 31),
    ],
)
def test_the_hour_is_the_sun_s_where_the_clock_is_utc(
    tmp_path: Path, clock: Clock, longitude_deg: float, hour: float, day: int
) -> None:
    at = datetime(2026, 1, 31, 22, 30)
    found = moment_of_track(track(tmp_path, clock, at, longitude_deg))
    assert found is not None
    assert found.hour == pytest.approx(hour)
    assert found.day_of_year == day
    assert found.basis == ("UTC" if clock is Clock.UTC else "recorder")


def test_a_track_without_a_clock_says_nothing_of_when(tmp_path: Path) -> None:
    at = datetime(2026, 1, 31, 22, 30)
    assert moment_of_track(track(tmp_path, Clock.NONE, at, 8.0)) is None


@pytest.mark.parametrize(
    ("day", "lat_deg", "season"),
    [(1, 47.0, "winter"), (59, 47.0, "winter"), (60, 47.0, "spring"), (200, 47.0, "summer"),
     (330, 47.0, "autumn"), (335, 47.0, "winter"), (366, 47.0, "winter"), (200, -33.0, "winter"),
     (1, -33.0, "summer")],
)  # fmt: skip
def test_seasons_turn_with_the_hemisphere(day: int, lat_deg: float, season: str) -> None:
    moment = FlightMoment(clock_s=0.0, hour=14.99, day_of_year=day, basis="UTC")
    assert bin_of(moment, lat_deg) == f"{season}, 12-15 h"


def test_columns_say_where_the_wind_comes_from(tmp_path: Path) -> None:
    feet = np.array([[5.0, 10.0, 0.0], [-8.0, -15.0, 0.0]])
    one = flight(tmp_path, Flown(name="windy", feet=feet, lean=(0.3, 0.0)))
    offsets = [offset_of(one, FIELD)]
    wind = wind_of(one, sightings_of([one], offsets))
    assert wind is not None
    np.testing.assert_allclose(wind.lean, (0.3, 0.0), atol=1e-5)
    assert wind.from_deg == pytest.approx(270.0, abs=0.1)
    assert 0.01 < wind.sigma < 0.03
    assert wind_of(one, []) is None


def test_a_flight_covered_what_it_flew_over(tmp_path: Path) -> None:
    one = flight(tmp_path, Flown(name="over"))
    covered = measure_coverage(one, FIELD, CELL_M, COLUMN)
    centres = (np.indices(covered.limit_px.shape)[::-1].T + covered.low + 0.5) * CELL_M
    east, north = centres.transpose(2, 1, 0)
    found = np.isfinite(covered.limit_px)
    assert found[(np.abs(east) < 12) & (np.abs(north) < 30)].all()
    assert not found[np.abs(east) > 24].any(), "outside of every frame"
    assert 2500 < found.sum() * CELL_M**2 < 43 * 104, "frames of 43 m by 32 m, along 72 m"


def test_a_noisier_flight_finds_only_stronger_columns(tmp_path: Path) -> None:
    weakest = []
    for name, sigma_px in (("clear", 0.05), ("hazy", 0.2)):
        covered = measure_coverage(
            flight(tmp_path, Flown(name=name, sigma_px=sigma_px)), FIELD, CELL_M, COLUMN
        )
        weakest.append(float(np.median(covered.limit_px[np.isfinite(covered.limit_px)])))
    assert 2 < weakest[1] / weakest[0] < 8


def test_a_flight_finds_what_its_detector_sees(tmp_path: Path) -> None:
    one = flight(tmp_path, Flown(name="keen"))
    by_hand = measure_coverage(one, FIELD, CELL_M, COLUMN)
    path = one.folder / "detections" / "index.json"
    response = Response(ratios=(0.0, 0.6), llr=(-1.0, 4.0))
    path.write_text(json.dumps(json.loads(path.read_text()) | {"response": response.to_plain()}))
    keen = measure_coverage(one, FIELD, CELL_M, COLUMN)
    seen = np.isfinite(by_hand.limit_px)
    assert (keen.limit_px[seen] <= by_hand.limit_px[seen]).all()
    assert np.median(keen.limit_px[seen]) < np.median(by_hand.limit_px[seen]) / 2


def test_what_was_seen_is_stated_in_the_terms_of_the_limit(tmp_path: Path) -> None:
    strong = measure_coverage(flight(tmp_path, Flown(name="one", feet=SITE)), FIELD, CELL_M, COLUMN)
    hazy = flight(tmp_path, Flown(name="two", feet=SITE, sigma_px=0.2))
    assert strong.seen_px.shape == (1,)
    assert strong.seen_px[0] > np.median(strong.limit_px[np.isfinite(strong.limit_px)]) / 2
    ratio = measure_coverage(hazy, FIELD, CELL_M, COLUMN).seen_px[0] / strong.seen_px[0]
    assert 2 < ratio < 8, "the same evidence from noisier frames takes a stronger column"


def test_coverage_is_kept_until_something_changes(tmp_path: Path) -> None:
    one = flight(tmp_path, Flown(name="kept"))
    job = CoverageJob(folder=tmp_path, frame=FIELD, cell_m=CELL_M, column=COLUMN)
    path = tmp_path / "kept.npz"
    assert job(one) is None
    stamp = path.stat().st_mtime_ns
    assert job(one) is None
    assert path.stat().st_mtime_ns == stamp
    assert replace(job, cell_m=2 * CELL_M)(one) is None
    assert FlightCoverage.load(path).limit_px.size < 200
    path.write_bytes(b"broken")
    assert job(one) is None
    assert FlightCoverage.load(path).limit_px.size > 200


def test_a_flight_without_detections_says_so(tmp_path: Path) -> None:
    one = flight(tmp_path, Flown(name="bare"))
    job = CoverageJob(folder=tmp_path, frame=FIELD, cell_m=CELL_M, column=COLUMN)
    job(one)
    for path in (one.folder / "detections").iterdir():
        path.unlink()
    assert job(one) is None, "its coverage is known from before"
    (tmp_path / "bare.npz").unlink()
    why = job(one)
    assert why is not None
    assert "detections" in why


def test_cells_too_small_are_refused(tmp_path: Path) -> None:
    one = flight(tmp_path, Flown(name="fine"))
    with pytest.raises(BadInputError, match="give larger cells"):
        measure_coverage(one, FIELD, 0.2, COLUMN)


def test_the_threshold_is_drawn_again_where_the_run_did_not_keep_it(tmp_path: Path) -> None:
    from locate.survey.coverage import threshold_nats

    one = flight(tmp_path, Flown(name="old"))
    assert threshold_nats(one.folder, views_of(one.folder)) == pytest.approx(20.0)
    (one.folder / "evidence.npz").unlink()
    again = threshold_nats(one.folder, views_of(one.folder))
    assert np.isfinite(again)
    assert again != pytest.approx(20.0)


def test_a_place_is_shared_between_the_cells_it_may_be_in() -> None:
    spot = SightingPlace(flight=0, position=np.array([4.0, 2.0]), covariance=np.diag([1.0, 0.01]))
    shares = spread_over_cells(spot, np.array([0, 0]), (1, 2), CELL_M)
    np.testing.assert_allclose(shares, [[0.5, 0.5]], atol=0.15)
    assert shares.sum() == pytest.approx(1.0)


def test_seen_is_never_more_than_covered() -> None:
    blind = FlightCoverage(
        low=np.array([0, 0]),
        limit_px=np.full((3, 3), np.inf, np.float32),
        seen_px=np.zeros(0, np.float32),
    )
    clear = replace(blind, low=np.array([1, 0]), limit_px=np.full((3, 3), 0.5, np.float32))
    spot = SightingPlace(flight=0, position=np.array([6.0, 6.0]), covariance=0.01 * np.eye(2))
    cells = count_cells(
        [blind, clear, None], ["a", "b", "b"], [spot],
        bins=("a", "b"), cell_m=CELL_M, weakest_px=1.0,
    )  # fmt: skip
    assert cells is not None
    assert cells.shape == (3, 4)
    assert cells.covered[0].sum() == cells.seen[0].sum() == pytest.approx(1.0)
    assert cells.covered[1].tolist() == [[0, 1, 1, 1]] * 3
    assert cells.overall_probability[0][1, 1] > 5 * cells.overall_probability[0][1, 2]
    assert np.isnan(cells.overall_probability[0][0, 0])


def test_heights_over_take_off_are_left_free(tmp_path: Path) -> None:
    one = flight(tmp_path, Flown(name="low"))
    assert one.map is not None
    block = {**one.map["georeference"], "height_datum": "take-off"}
    over_take_off = one.model_copy(update={"map": {**one.map, "georeference": block}})
    assert offset_of(one, FIELD).covariance[5, 5] < 10.0
    assert offset_of(over_take_off, FIELD).covariance[5, 5] > 1000.0
