"""A position against its neighbours: strays are left out, breaks are noted."""

from pathlib import Path

import numpy as np
import pytest

from locate.telemetry import TelemetryTrack
from locate.telemetry.assemble import track_from_columns

RECORDS = 20


def flight(**changed: object) -> TelemetryTrack:
    """20 records, one a second, at 10 m/s to the north."""
    columns = {
        "times_s": np.arange(RECORDS, dtype=float),
        "latitude_deg": 48 + np.arange(RECORDS) * 9e-5,
        "longitude_deg": np.full(RECORDS, 179.99999),
    }
    arrays = {name: np.asarray(values, dtype=float) for name, values in changed.items()}
    return track_from_columns(Path("a.csv"), "test", columns | arrays)


def test_a_flight_over_the_date_line_is_left_alone() -> None:
    longitude = np.where(np.arange(RECORDS) % 2, -179.9999, 179.9999)
    found = flight(longitude_deg=longitude)
    assert found.has_position.all()
    assert found.warnings == ()


def test_strays_are_left_out_and_counted() -> None:
    latitude = 48 + np.arange(RECORDS) * 9e-5
    latitude[[0, 7, 12]] = [11.5, -48, 48.1]
    found = flight(latitude_deg=latitude, altitude_m=np.full(RECORDS, 500.0))
    assert np.flatnonzero(~found.has_position).tolist() == [0, 7, 12]
    assert found.altitude_m == pytest.approx(500)
    assert found.warnings == (
        "a.csv: 3 of 20 positions were left out, as no vehicle gets there and back "
        "(the first at 0.00 s)",
    )


def test_a_break_is_noted_and_nothing_left_out() -> None:
    latitude = np.where(np.arange(RECORDS) < 8, 48.0, -48.0)
    found = flight(latitude_deg=latitude)
    assert found.has_position.all()
    said = "1 of the steps between its positions are longer than any vehicle goes"
    assert f"{said} (the first at 8.00 s)" in found.warnings[0]


@pytest.mark.parametrize(("count", "is_left_out"), [(RECORDS, True), (3, False)])
def test_a_photo_far_from_the_others(count: int, is_left_out: bool) -> None:
    latitude = np.full(count, -33.8)
    latitude[1] = 33.8
    columns = {"latitude_deg": latitude, "longitude_deg": np.full(count, 151.2)}
    names = [f"{i}.jpg" for i in range(count)]
    columns["altitude_m"] = np.full(count, 50.0)
    found = track_from_columns(Path("photos"), "photo", columns, names=names)
    assert found.has_position[1] != is_left_out
    assert (
        f"1 of {count} positions are over 100 km from the others (the first: 1.jpg)"
        in (found.warnings[0])
    )
