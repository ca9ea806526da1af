"""Positions in subtitles: the order of latitude and longitude by the form, or refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from geometry.errors import BadInputError
from locate.telemetry import TelemetryTrack, read_telemetry

PROPERTY = settings(
    max_examples=200,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def read(folder: Path, *bodies: str) -> TelemetryTrack:
    path = folder / "a.srt"
    cues = (
        f"{i + 1}\n00:00:0{i},000 --> 00:00:0{i + 1},000\n{body}\n\n"
        for i, body in enumerate(bodies)
    )
    path.write_text("".join(cues))
    return read_telemetry(path)


@pytest.mark.parametrize(
    ("body", "latitude", "longitude", "altitude"),
    [
        ("GPS(8.5000,47.1000,19) BAROMETER:20.1", 47.1, 8.5, 20.1),
        ("F/2.8, GPS (-121.7458, 48.0771, 17), D 221.21m", 48.0771, -121.7458, np.nan),
        ("GPS(36.6146,-6.1120,12.0M) BAROMETER:0.3M", 36.6146, -6.112, 12),
        (
            "GPS(48.137154,11.575382,569.800) BAROMETER(91.2) HOME(48.137100,11.575400)",
            48.137154,
            11.575382,
            569.8,
        ),
        ("GPS(39.906217,116.391305,570) BAROMETER(91.2)", 39.906217, 116.391305, 570),
        (
            "HOME(W: 117.9, S: 33.6)\nGPS(W: 117.9605, S: 33.6323, 37.00m)",
            -33.6323,
            -117.9605,
            37,
        ),
        ("GPS(E: 24.9405, N: 60.1723, 37.00m) ISO:100", 60.1723, 24.9405, 37),
        ("GPS(N: 60.1723, E: 24.9405, 37.00m) ISO:100", 60.1723, 24.9405, 37),
        ("GPS(W: -117.9605, N: 33.6323, -37) ReH:0", 33.6323, -117.9605, -37),
        ("GPS(116.391305, 39.906217, 69.8)", 39.906217, 116.391305, np.nan),
        ("[latitude: 47.1] [longtitude : 8.5] [altitude: 12.5]", 47.1, 8.5, 12.5),
        ("[latitude: 33.8 S] [longitude: 70.6 W]", -33.8, -70.6, np.nan),
        ("latitude: 47.1 longitude: 8.5 altitude: 12.5 x", 47.1, 8.5, 12.5),
    ],
)
def test_known_forms(
    tmp_path: Path, body: str, latitude: float, longitude: float, altitude: float
) -> None:
    found = read(tmp_path, body)
    where = (found.latitude_deg[0], found.longitude_deg[0], found.altitude_m[0])
    assert where == pytest.approx((latitude, longitude, altitude), nan_ok=True)
    assert found.warnings == ()


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("GPS(48.137154,11.575382,569.800)", "cannot be known"),
        ("GPS(48.137154,11.575382,569)", "cannot be known"),
        ("GPS(48.137154,11.575382,0)", "cannot be known"),
        ("GPS(48.137154,11.575382,569.8m)", "cannot be known"),
        ("GPS(39.906217,116.391305,17)", "contradict each other"),
        ("GPS(116.391305,39.906217,12.0M)", "contradict each other"),
        ("GPS(W: -117.-9605, N: 33.6323, -37)", "no known form of a coordinate"),
        ("GPS(E: -117.9605, N: 33.6323, 37.00m)", "contradict each other"),
        ("GPS(N: 33.6323, N: 117.9605, 37.00m)", "N is no side of a longitude"),
        ("GPS(W: 117.9605, 33.6323, 37.00m)", "a letter before one"),
        ("GPS(48,137,11,575,569)", "not one GPS"),
        ("GPS(48.1,11.5)", "not one GPS"),
        ("GPS(x48.1,11.5,12)", "no known form of a coordinate"),
        ("GPS(48.1,11.5,twelve)", "no known form of the third"),
        ("GPS(48.1,11.5,12) GPS(11.5,48.1,12)", "not one GPS"),
        ("[latitude: 48,1] [longitude: x8.5]", "no known form"),
        ("[latitude: 148.1] [longitude: 8.5]", "beyond the largest latitude"),
        ("[latitude: 48.1 W] [longitude: 8.5]", "W is no side of a latitude"),
    ],
)
def test_what_cannot_be_known_is_refused_with_its_line(tmp_path: Path, body: str, why: str) -> None:
    with pytest.raises(BadInputError, match=why) as refused:
        read(tmp_path, f"FrameCnt: 1\n{body}")
    assert "a.srt, line 4: " in str(refused.value)
    assert "\n" not in str(refused.value)


def test_one_order_in_one_file(tmp_path: Path) -> None:
    found = read(tmp_path, "GPS(11.5,48.1,12)", "GPS(11.6,48.2,12.5)", "GPS(bad,48.2,12)")
    assert found.latitude_deg == pytest.approx([48.1, 48.2])
    assert "1 of the values under GPS left out" in found.warnings[0]
    assert "line 11" in found.warnings[0]
    with pytest.raises(BadInputError, match="contradict each other"):
        read(tmp_path, "GPS(11.5,48.1,12)", "GPS(48.1,11.5,12.5M)")


@PROPERTY
@given(
    first=st.floats(-180, 180).map(lambda x: f"{x:.6f}"),
    second=st.floats(-180, 180).map(lambda x: f"{x:.6f}"),
    third=st.sampled_from(["12", "570", "12.5M", "12.5", "12.5m"]),
    rest=st.sampled_from([" BAROMETER:3", " BAROMETER(3)", ""]),
)
def test_a_tuple_is_read_in_its_order_or_refused(
    tmp_path: Path, first: str, second: str, third: str, rest: str
) -> None:
    assume(any(float(number) for number in (first, second)))
    is_latitude_first = third.endswith("M") or ("(" in rest and not third.endswith("m"))
    is_longitude_first = third == "12" and not is_latitude_first
    try:
        found = read(tmp_path, f"GPS({first},{second},{third}){rest}")
    except BadInputError:
        latitude = float(first if is_latitude_first else second)
        assert abs(latitude) > 90 or not (is_latitude_first or is_longitude_first)
        return
    values = [float(first), float(second)]
    if not (is_latitude_first or is_longitude_first):
        assert max(abs(value) for value in values) > 90
        is_latitude_first = abs(values[1]) > 90
    expected = values if is_latitude_first else values[::-1]
    assert (found.latitude_deg[0], found.longitude_deg[0] % 360) == pytest.approx(
        (expected[0], expected[1] % 360)
    )


ASS = """[Script Info]
ScriptType: v4.00+

[V4+ Styles]
Format: Name, Fontname
Style: Default,Arial

[Events]
Format: Layer, Start, End, Style, Name, MarginL, MarginR, MarginV, Effect, Text
"""


def ass_line(start: str, text: str) -> str:
    return f"Dialogue: 0,{start},0:00:09.00,Default,,0,0,0,,{text}\n"


def test_subtitles_of_autel_are_read_as_those_of_srt(tmp_path: Path) -> None:
    path = tmp_path / "MAX_0001.ass"
    text = "{{\\pos(5,5)}}HOME(W: 117.9, S: 33.6) 2024.3.8 16:49:2{0}\\NGPS(W: {1}, S: 33.6, 37.5m)"
    lines = [ass_line(f"0:00:0{i}.50", text.format(i, 117.9605 + i / 1e4)) for i in range(3)]
    path.write_text(ASS + "".join(lines))
    found = read_telemetry(path)
    assert found.times_s == pytest.approx([0.5, 1.5, 2.5])
    assert found.latitude_deg == pytest.approx([-33.6] * 3)
    assert found.longitude_deg == pytest.approx([-117.9605, -117.9606, -117.9607])
    assert found.altitude_m == pytest.approx([37.5] * 3)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (ass_line("0:00:01", "GPS(W: 117.9x, S: 33.6, 37m)"), "line 10"),
        (ass_line("soon", "GPS(W: 117.9, S: 33.6, 37m)"), "line 10: no subtitle with a start"),
        ("Dialogue: 0,0:00:01.00\n", "line 10: no subtitle with a start"),
        (ass_line("0:00:01.00", "no position"), "position"),
    ],
)
def test_ass_of_no_known_form_is_refused(tmp_path: Path, line: str, reason: str) -> None:
    path = tmp_path / "a.ass"
    path.write_text(ASS + line)
    with pytest.raises(BadInputError, match=reason):
        read_telemetry(path)
