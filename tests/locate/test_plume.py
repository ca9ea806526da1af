import json
import re
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from detect.haze import Haze
from geometry.errors import BadInputError
from locate.export.table import map_table
from locate.map.answer import Answer, Cause, Obstacle
from locate.map.plume import Bearing, PlumeMap
from tests.locate.answers import plume, plume_map

GEOREFERENCE = {
    "origin_lat_deg": 60.0,
    "origin_lon_deg": 25.0,
    "origin_height_m": 10.0,
    "height_datum": "WGS84 ellipsoid",
}
CONTRACT = {"units", "gravity", "georeference", "plumes", "detection_limit_px", "detector"}
PLUME_CONTRACT = {
    *("id", "source", "source_covariance", "axis", "axis_sigma_rad", "extent_low", "extent_high"),
    *("radius_by_height", "evidence_nats", "probability", "views", "displacement_px"),
}

DARK = Obstacle(cause=Cause.NOISE, why="It was dark.", remedy="Film by day.")
BEARING = Bearing(
    direction_in_cam=np.array([0.0, 0.0, 1.0]),
    sigma_rad=0.01,
    evidence_nats=9.0,
    probability=0.9,
    displacement_px=0.4,
)


def test_a_map_reads_back_as_it_was_written(tmp_path: Path) -> None:
    written = plume_map(
        plume(),
        plume(id=2, radius_by_height=np.zeros((0, 2)), source_hidden=True),
        bearings=(BEARING,),
        georeference=GEOREFERENCE,
        detection_limit_k=12.0,
        notes=("one sentence",),
    )
    written.save(tmp_path / "map.json")
    read = PlumeMap.load(tmp_path / "map.json")
    assert read.to_dict() == written.to_dict()
    assert read.plumes[1].radius_by_height.shape == (0, 2)
    assert read.plumes[0].views == (0, 2, 4)
    assert read.georeference == GEOREFERENCE


def test_haze_is_read_back_and_said_by_height(tmp_path: Path) -> None:
    haze = Haze(rms_px=0.62, cells_px=((0.4, None), (None, None), (0.9, 1.1)))
    plume_map(haze=haze).save(tmp_path / "map.json")
    read = PlumeMap.load(tmp_path / "map.json")
    assert read.haze == haze
    assert read.limit_text() == (
        "Haze: the air moves all over the image, 0.62 px rms, 0.4 px at the top and 1 px at the "
        "bottom; no single plume stands out of it. A plume of 0.25 px would have been seen in half "
        "of the places."
    )


def test_the_file_has_the_keys_of_the_contract(tmp_path: Path) -> None:
    plume_map(plume()).save(tmp_path / "map.json")
    content = json.loads((tmp_path / "map.json").read_text())
    assert content["schema"] == "locate.map/2"
    assert set(content) >= CONTRACT | {"version"}
    assert set(content["plumes"][0]) >= PLUME_CONTRACT


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "locate.map/3"}, "schema is 'locate.map/3', expected 'locate.map/2'"),
        ({"units": "feet"}, "units"),
        ({"plumes": [{"id": 1}]}, r"plumes\.0\.source"),
        ({"obstacles": [{"cause": "bad_luck", "why": "", "remedy": ""}]}, "obstacles.0.cause"),
        ({"detection_limit_px": float("nan")}, "detection_limit_px"),
        ({"georeference": {"origin_lat_deg": 91.0}}, r"georeference\.origin_lat_deg"),
    ],
)
def test_a_wrong_file_is_named_with_its_fault(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    path = tmp_path / "map.json"
    path.write_text(json.dumps(plume_map(plume()).to_dict() | change))
    with pytest.raises(BadInputError, match=message) as caught:
        PlumeMap.load(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("plumes", "changes", "answer", "sentence"),
    [
        ((plume(),), {}, Answer.FOUND, "One found; a plume of 0.25 px would have been seen"),
        ((), {"bearings": (BEARING,), "detection_limit_px": None}, Answer.FOUND, "One direction"),
        ((), {}, Answer.NONE_FOUND, "None found; a plume of 0.25 px would have been seen"),
        (
            (),
            {"detection_limit_px": None, "obstacles": (DARK,)},
            Answer.NOT_JUDGED,
            "Nothing could be judged. It was dark.",
        ),
        ((), {"detection_limit_px": None}, Answer.NOT_JUDGED, "Why is not known."),
    ],
)
def test_three_answers_are_told_apart(
    tmp_path: Path, plumes: tuple[Any, ...], changes: dict[str, Any], answer: Answer, sentence: str
) -> None:
    plume_map(*plumes, **changes).save(tmp_path / "map.json")
    assert json.loads((tmp_path / "map.json").read_text())["answer"] == answer.value
    read = PlumeMap.load(tmp_path / "map.json")
    assert read.answer is answer
    assert sentence in read.limit_text()
    assert read.obstacles == changes.get("obstacles", ())


def test_a_map_of_the_earlier_version_is_read(tmp_path: Path) -> None:
    content = plume_map(plume()).to_dict() | {"schema": "locate.map/1"}
    del content["answer"], content["obstacles"]
    (tmp_path / "map.json").write_text(json.dumps(content))
    assert PlumeMap.load(tmp_path / "map.json").answer is Answer.FOUND


@pytest.mark.parametrize("text", ["", "[]", "{}", "no json"])
def test_what_is_no_map_is_bad_input(tmp_path: Path, text: str) -> None:
    (tmp_path / "map.json").write_text(text)
    with pytest.raises(BadInputError):
        PlumeMap.load(tmp_path / "map.json")


def test_no_number_of_the_file_is_nan(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        plume_map(plume(evidence_nats=np.nan)).save(tmp_path / "map.json")


def test_sigmas_are_those_of_the_principal_axes() -> None:
    np.testing.assert_allclose(plume().principal_sigmas, [0.03, 0.02, 0.01])


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match=r"source_covariance.shape=\(3,\)"):
        plume(source_covariance=np.ones(3))


@pytest.mark.parametrize(
    ("plumes", "limits", "sentence"),
    [
        ((), {}, "None found; a plume of 0.25 px would have been seen in half of the places."),
        (
            (),
            {"detection_limit_k": 30.0},
            "0.25 px, about 30 K warmer than the air, would have been seen in half",
        ),
        ((plume(),), {"detection_limit_px": None}, "One found; .* not known"),
        ((), {"detection_limit_px": None, "bearings": (BEARING,)}, r"^One direction found\.$"),
    ],
)
def test_the_limit_is_said_in_words(
    plumes: tuple[Any, ...], limits: dict[str, Any], sentence: str
) -> None:
    text = plume_map(*plumes, **limits).limit_text()
    assert re.search(sentence, text)


def test_the_table_has_a_value_and_a_unit_for_each_quantity() -> None:
    text = StringIO()
    Console(width=120, file=text).print(map_table(plume_map(plume())))
    lines = text.getvalue().splitlines()
    for words in (("source x, y, z", "0.300, -0.200, 0.100", " m "), ("probability", "> 0.999")):
        assert any(all(word in line for word in words) for line in lines), words
