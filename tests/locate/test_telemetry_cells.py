"""Cells of tables: read exactly, or refused with their line."""

from math import isnan
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geometry.errors import BadInputError
from locate.telemetry import Clock, TelemetryTrack, read_telemetry
from locate.telemetry.cells import (
    LENGTHS,
    UnknownForm,
    parse_clock_time,
    parse_coordinate,
    parse_quantity,
)

PROPERTY = settings(
    max_examples=300,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def read(folder: Path, text: str, name: str = "table.csv") -> TelemetryTrack:
    path = folder / name
    path.write_text(text)
    return read_telemetry(path)


@pytest.mark.parametrize(
    ("text", "axis", "degrees"),
    [
        ("-33.8688", "latitude", -33.8688),
        ("+33.8688", "latitude", 33.8688),
        ("33.8688 S", "latitude", -33.8688),
        ("S33.8688", "latitude", -33.8688),
        ("S: 33.8688", "latitude", -33.8688),
        ("33.8688° south", "latitude", -33.8688),
        ("-33.8688 S", "latitude", -33.8688),
        ("W -70.5", "longitude", -70.5),
        ("48,1234", "latitude", 48.1234),
        ("1e-05", "longitude", 1e-5),
        ("270.5", "longitude", 270.5),
        ("46 deg 50' 34.00\" N", "latitude", 46 + 50 / 60 + 34 / 3600),
        ("91° 59′ 39.48″ W", "longitude", -(91 + 59 / 60 + 39.48 / 3600)),  # noqa: RUF001
        ("-33 52 7.68", "latitude", -(33 + 52 / 60 + 7.68 / 3600)),
        ("33:52:07.68S", "latitude", -(33 + 52 / 60 + 7.68 / 3600)),
        ("33° 52.128' S", "latitude", -(33 + 52.128 / 60)),
        ("46 deg 50' 60.00\" N", "latitude", 46 + 51 / 60),
        ("n/a", "latitude", np.nan),
        ("", "longitude", np.nan),
    ],
)
def test_coordinates(text: str, axis: str, degrees: float) -> None:
    assert parse_coordinate(text, axis) == pytest.approx(degrees, abs=1e-12, nan_ok=True)


@pytest.mark.parametrize(
    ("text", "axis"),
    [
        ("33.8688 N", "longitude"),
        ("-33.8688 N", "latitude"),
        ("+33.8688 S", "latitude"),
        ("N 33.8688 S", "latitude"),
        ("123", "latitude"),
        ("481234", "latitude"),
        ("4807.038", "latitude"),
        ("0007.038 N", "latitude"),
        ("48 7 24.1", "latitude"),
        ("46 deg 50' 34.00\"", "latitude"),
        ("48 77 24.1 N", "latitude"),
        ("48, 7, 24", "latitude"),
        ("48.137.154", "latitude"),
        ("1.234,5", "longitude"),
        ("48.1234abc", "latitude"),
        ("lat 48.1234", "latitude"),
        ("-117.-9605", "longitude"),
        ("inf", "latitude"),
        ("-190", "longitude"),
    ],
)
def test_what_is_no_coordinate_is_refused(text: str, axis: str) -> None:
    with pytest.raises(UnknownForm):
        parse_coordinate(text, axis)


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("198.6 m Above Sea Level", 198.6),
        ("198.6 m Below Sea Level", -198.6),
        ("+1054.447", 1054.447),
        ("100 ft", 30.48),
        ("nan", np.nan),
    ],
)
def test_heights(text: str, metres: float) -> None:
    assert parse_quantity(text, LENGTHS) == pytest.approx(metres, nan_ok=True)


@pytest.mark.parametrize("text", ["1,234", "512,4", "12 parsec", "5 m 3", "a5", "--5", "m"])
def test_what_is_no_height_is_refused(text: str) -> None:
    with pytest.raises(UnknownForm):
        parse_quantity(text, LENGTHS)


def test_times_of_day() -> None:
    assert parse_clock_time("12:34:56.5") == 45_296.5
    assert parse_clock_time("1:00:00 pm") == 46_800
    assert parse_clock_time("12:00:00 AM") == 0
    for text in ("12:34", "25:00:00", "12:61:00", "12:00:60", "13:00:00 pm", "x12:00:00"):
        assert isnan(parse_clock_time(text))


@PROPERTY
@given(
    degrees=st.floats(0, 89.99),
    is_south=st.booleans(),
    form=st.sampled_from(["sign", "after", "before", "dms", "column", "dm"]),
)
def test_a_coordinate_survives_every_form(degrees: float, is_south: bool, form: str) -> None:
    side, sign = ("S", -1.0) if is_south else ("N", 1.0)
    whole, minutes = int(degrees), 60 * (degrees - int(degrees))
    texts = {
        "sign": f"{sign * degrees:.9f}",
        "after": f"{degrees:.9f} {side}",
        "before": f"{side} {degrees:.9f}",
        "column": f"{degrees:.9f}",
        "dm": f"{whole}° {min(minutes, 59.9999999):.7f}' {side}",
        "dms": f"{whole} deg {int(minutes)}' {60 * (minutes - int(minutes)):.5f}\" {side}",
    }
    found = parse_coordinate(texts[form], "latitude", side if form == "column" else None)
    assert found == pytest.approx(sign * degrees, abs=2e-8)


@PROPERTY
@given(text=st.text(alphabet="0123456789.,-+ NSEWnse°'\":degm", max_size=14))
def test_any_cell_is_read_in_range_or_refused(text: str) -> None:
    for axis, largest in (("latitude", 90), ("longitude", 360)):
        try:
            degrees = parse_coordinate(text, axis)
        except UnknownForm:
            continue
        assert isnan(degrees) or abs(degrees) <= largest
        digits = "".join(c for c in text if c.isdigit())
        assert bool(digits) != isnan(degrees)
        if text.replace(".", "", 1).isdecimal():
            assert degrees == float(text)


def test_hemispheres_in_columns_of_their_own(tmp_path: Path) -> None:
    found = read(
        tmp_path,
        "FileName,GPSLatitudeRef,GPSLatitude,GPSLongitudeRef,GPSLongitude,GPSAltitudeRef,"
        "GPSAltitude\na.jpg,S,33.8688,W,70.6483,1,100\n"
        "b.jpg,South,33.8689,West,70.6484,Below Sea Level,101\n"
        "c.jpg,,33.8690,W,70.6485,0,102\n"
        "d.jpg,N,-33.8690,W,70.6485,0,102\n",
    )
    assert found.latitude_deg == pytest.approx([-33.8688, -33.8689, np.nan, np.nan], nan_ok=True)
    assert found.longitude_deg[:2] == pytest.approx([-70.6483, -70.6484])
    assert found.altitude_m == pytest.approx([-100, -101, 102, 102])
    assert "2 of the values under GPSLatitude left out" in found.warnings[0]
    assert "line 4" in found.warnings[0]


def test_exif_coordinates_without_their_reference_are_refused(tmp_path: Path) -> None:
    text = "SourceFile,EXIF:GPSLatitude,EXIF:GPSLongitude\na.jpg,33.8688,70.6483\n"
    with pytest.raises(BadInputError, match=r"line 2: EXIF:GPSLatitude '33\.8688': its hemisphere"):
        read(tmp_path, text)
    signed = text.replace("EXIF:", "Composite:").replace("33.8688", "-33.8688")
    assert read(tmp_path, signed).latitude_deg == pytest.approx([-33.8688])


def test_decimal_commas(tmp_path: Path) -> None:
    found = read(
        tmp_path,
        "filename;latitude;longitude;altitude\na.jpg;48,1234;11,5678;512,4\n"
        "b.jpg;-48,123;-11,567;1,234\n",
    )
    assert found.latitude_deg == pytest.approx([48.1234, -48.123])
    assert found.longitude_deg == pytest.approx([11.5678, -11.567])
    assert found.altitude_m == pytest.approx([512.4, 1.234])
    mixed = read(tmp_path, "name;lat;lon;alt\na.jpg;48.1234;11.5678;1,234\n")
    assert np.isnan(mixed.altitude_m[0])
    assert "thousands or decimals?" in mixed.warnings[0]


def test_decimal_commas_between_commas_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"line 2: row 'a\.jpg,48,12,11,56': 5 cells under 3"):
        read(tmp_path, "filename,latitude,longitude\na.jpg,48,12,11,56\n")


def test_times_of_day_in_a_table(tmp_path: Path) -> None:
    rows = "".join(f"2024-05-01,12:34:5{i},48.100{i},11.5,500\n" for i in range(6, 10))
    found = read(tmp_path, "date,time,lat,lon,alt\n" + rows)
    assert found.times_s == pytest.approx([0, 1, 2, 3])
    assert (found.clock, found.clock_s[0]) == (Clock.LOCAL, 1_714_566_896)
    assert found.latitude_deg == pytest.approx([48.1006, 48.1007, 48.1008, 48.1009])
    night = read(tmp_path, "time,lat,lon\n23:59:59.5,48.1,11.5\n00:00:00.5,48.1001,11.5\n")
    assert np.diff(night.times_s) == pytest.approx([1])


def test_times_of_no_known_form_are_counted(tmp_path: Path) -> None:
    found = read(tmp_path, "time,lat,lon\n0,48.1,11.5\n1,48.1001,11.5\n12:34,48.1002,11.5\n")
    assert found.times_s == pytest.approx([0, 1])
    assert "line 4: time '12:34'" in found.warnings[0]
    assert "1 of 3 records were left out" in found.warnings[1]


def test_exiftool_names_photos_by_source_file(tmp_path: Path) -> None:
    found = read(
        tmp_path,
        "SourceFile,GPSLatitude,GPSLongitude,GPSAltitude\n"
        './a/DJI_0020.JPG,"46 deg 50\' 34.00"" N","91 deg 59\' 39.48"" W",198.6 m Above Sea Level\n'
        './a/DJI_0029.JPG,"46 deg 50\' 32.76"" N","91 deg 59\' 39.60"" W",1.5 m Below Sea Level\n',
    )
    assert found.rows_of(["DJI_0029.JPG", "DJI_0020.JPG"]).tolist() == [1, 0]
    assert found.latitude_deg[0] == pytest.approx(46 + 50 / 60 + 34 / 3600)
    assert found.longitude_deg[0] == pytest.approx(-(91 + 59 / 60 + 39.48 / 3600))
    assert found.altitude_m == pytest.approx([198.6, -1.5])


def test_a_unit_that_is_not_known_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"line 1: the unit of 'altitude \(yd\)'"):
        read(tmp_path, "name,lat,lon,altitude (yd)\na.jpg,48.1,11.5,500\n")
    with pytest.raises(BadInputError, match=r"the unit of 'lat \(rad\)'"):
        read(tmp_path, "name,lat (rad),lon (rad)\na.jpg,0.8,0.2\n")


@PROPERTY
@given(cell=st.text(alphabet="0123456789.,-+ NSEW°'\"", min_size=1, max_size=10))
def test_any_cell_of_a_table_is_read_as_alone_or_refused(tmp_path: Path, cell: str) -> None:
    quoted = cell.replace('"', '""')
    try:
        found = read(tmp_path, f'name,lat,lon\na.jpg,"{quoted}",11.5\nb.jpg,48.1,11.5\n')
        alone = parse_coordinate(cell, "latitude")
    except UnknownForm:
        assert found.names == ("b.jpg",)
        assert "line 2" in found.warnings[0]
    else:
        assert found.latitude_deg[0] == alone or isnan(alone)


@pytest.mark.parametrize("titles", ["lat,N/S,lon,E/W", "lat,lat_dir,lon,lon_dir", "lat,x,lon,y"])
def test_hemispheres_beside_their_coordinates(tmp_path: Path, titles: str) -> None:
    found = read(tmp_path, f"name,{titles}\na.jpg,33.8688,S,70.6483,W\n")
    assert (found.latitude_deg[0], found.longitude_deg[0]) == (-33.8688, -70.6483)


@pytest.mark.parametrize("time", ["12:34", "12:00:00:15", "2024-05-01 12:00", "noon"])
def test_a_table_without_times_of_a_known_form_names_its_line(tmp_path: Path, time: str) -> None:
    with pytest.raises(BadInputError, match=rf"table\.csv, line 2: time '{time}': no known form"):
        read(tmp_path, f"time,lat,lon\n{time},48.1,11.5\n")


def test_two_photos_of_one_name_have_no_position(tmp_path: Path) -> None:
    found = read(
        tmp_path,
        "SourceFile,GPSLatitude,GPSLongitude,GPSAltitude\n"
        "a/1.JPG,48.1,11.5,500\nb/1.jpg,48.2,11.5,500\nb/2.jpg,48.2,11.6,500\n",
    )
    assert found.has_position.tolist() == [False, False, True]
    assert "2 positions were left out, as several photos of one name" in found.warnings[0]
