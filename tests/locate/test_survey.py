"""A survey of flights that never took place, from their run folders to the files."""

import json
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from geometry.errors import BadInputError
from locate.map.plume import PlumeMap
from locate.survey import flights as flights_module
from locate.survey.build import build_survey
from locate.survey.model import Survey, SurveySettings
from tests.locate.survey_runs import FIELD, Flown, write_run

SITES = np.array([[5.0, 10.0, 0.0], [-8.0, -15.0, 0.0], [10.0, -4.0, 0.0]])
STANDING = ([0, 1], [0, 2], [0], [0, 1, 2], [0, 1])
SETTINGS = SurveySettings(cell_m=4.0, wander_m=0.5)


def campaign(root: Path) -> list[Path]:
    """Five flights on five days, at 10, 12, 14, 16 and 18 o'clock."""
    return [
        write_run(
            root,
            Flown(
                name=f"flight_{i}",
                start=datetime(2026, 7, 1 + i, 10 + 2 * i),
                feet=SITES[standing],
                lean=(0.2, 0.0),
                seed=i + 1,
                take_off=(12.0 * i, -7.0 * i),
            ),
        )
        for i, standing in enumerate(STANDING)
    ]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return campaign(tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="module")
def done(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Survey, Path]:
    output = tmp_path_factory.mktemp("survey")
    return build_survey(runs, output, settings=SETTINGS), output


def test_hotspots_are_where_columns_stood(done: tuple[Survey, Path]) -> None:
    answer, _ = done
    assert len(answer.hotspots) == len(SITES)
    assert [spot.occurrence[0].seen for spot in answer.hotspots] == [5, 3, 2]
    sites = answer.frame.to_enu(FIELD.lat_lon_height(SITES[[0, 1, 2]]))
    for spot, site in zip(answer.hotspots, sites, strict=True):
        error = np.array(spot.position) - site
        assert error @ np.linalg.solve(np.array(spot.covariance), error) < 14.2  # 99.7 %
        assert np.hypot(*error[:2]) < 1.5
        sigma = np.sqrt(np.linalg.eigvalsh(np.array(spot.covariance)[:2, :2])[-1])
        assert sigma < 1.0, "five flights of 1 m know no more than one"


def test_a_covering_flight_that_saw_nothing_counts(done: tuple[Survey, Path]) -> None:
    answer, _ = done
    rare = answer.hotspots[2]
    assert (rare.occurrence[0].looked, rare.occurrence[0].seen) == (5, 2)
    by_bin = {count.bin: (count.looked, count.seen) for count in rare.occurrence[1:]}
    assert by_bin == {
        "summer, 09-12 h": (1, 0), "summer, 12-15 h": (2, 1), "summer, 15-18 h": (1, 1),
        "summer, 18-21 h": (1, 0),
    }  # fmt: skip
    assert rare.occurrence[0].low < 0.4 < rare.occurrence[0].high


def test_flights_that_cover_elsewhere_or_badly_do_not_count(tmp_path: Path) -> None:
    seen = write_run(tmp_path, Flown(name="seen", feet=SITES[:1]))
    blurred = write_run(tmp_path, Flown(name="blurred", sigma_px=5.0))
    answer = build_survey([seen, blurred], tmp_path / "out", settings=SETTINGS)
    assert (answer.hotspots[0].occurrence[0].looked, answer.hotspots[0].occurrence[0].seen) == (
        1,
        1,
    )
    weak = SETTINGS.model_copy(update={"displacement_px": 100.0})
    counts = build_survey([], tmp_path / "out", settings=weak).hotspots[0].occurrence[0]
    assert (counts.looked, counts.seen) == (1, 1), "coverage needs evidence, whatever the amplitude"


def test_another_flight_leaves_the_others_alone(
    runs: list[Path],
    done: tuple[Survey, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    build_survey(runs[:-1], tmp_path, settings=SETTINGS)
    stamps = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "looks").iterdir()}
    read = counted(monkeypatch, "read_flight")
    answer = build_survey(runs[-1:], tmp_path)
    assert len(read) == 1
    after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "looks").iterdir()}
    assert {name: after[name] for name in stamps} == stamps
    at_once = done[0].model_dump(exclude={"settings"})
    assert answer.model_dump(exclude={"settings"}) == at_once
    read.clear()
    build_survey(runs, tmp_path)
    assert not read


def counted(monkeypatch: pytest.MonkeyPatch, name: str) -> list[object]:
    calls: list[object] = []
    real: Callable[..., object] = getattr(flights_module, name)

    def counting(*arguments: object) -> object:
        calls.append(arguments)
        return real(*arguments)

    monkeypatch.setattr(flights_module, name, counting)
    return calls


def test_a_flight_that_fails_is_named_and_nothing_else_is_lost(
    runs: list[Path], tmp_path: Path
) -> None:
    lost = write_run(tmp_path, Flown(name="lost", feet=SITES[:1]))
    unplaced = replace(PlumeMap.load(lost / "map.json"), georeference=None)
    unplaced.save(lost / "map.json")
    (tmp_path / "notes.txt").write_text("no video")
    given = [tmp_path / "notes.txt", lost, *runs[:2]]
    answer = build_survey(given, tmp_path / "out", settings=SETTINGS)
    failures = {flight.name: flight.failure for flight in answer.flights if flight.failure}
    assert set(failures) == {"notes", "lost"}
    assert "give telemetry" in str(failures["lost"])
    assert [flight.name for flight in answer.mapped] == ["flight_0", "flight_1"]
    page = (tmp_path / "out" / "map.html").read_text()
    assert "lost is left out" in page
    assert len(answer.hotspots) == 3


def test_nothing_placed_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no video")
    with pytest.raises(BadInputError, match=r"no flight could be placed.*notes"):
        build_survey([tmp_path / "notes.txt"], tmp_path / "out")
    with pytest.raises(BadInputError, match="name its first flights"):
        build_survey([], tmp_path / "empty")
    with pytest.raises(BadInputError, match="no such recording"):
        build_survey([tmp_path / "gone.mp4"], tmp_path / "out")


def test_flights_of_one_name_are_kept_apart(tmp_path: Path) -> None:
    pair = []
    for day in ("monday", "tuesday"):
        (tmp_path / day).mkdir()
        pair.append(write_run(tmp_path / day, Flown(name="DJI_0001", feet=SITES[:1])))
    answer = build_survey(pair, tmp_path / "out", settings=SETTINGS)
    assert [flight.name for flight in answer.flights] == ["DJI_0001", "DJI_0001-2"]
    assert answer.hotspots[0].occurrence[0].seen == 2


def test_a_survey_is_read_back(done: tuple[Survey, Path], tmp_path: Path) -> None:
    answer, output = done
    assert Survey.load(output / "survey.json") == answer
    content = json.loads((output / "survey.json").read_text())
    assert content["schema"] == "locate.survey/1"
    for spoilt in ({**content, "schema": "locate.survey/9"}, {**content, "hotspots": 3}, [1]):
        (tmp_path / "survey.json").write_text(json.dumps(spoilt))
        with pytest.raises(BadInputError, match=r"survey\.json"):
            Survey.load(tmp_path / "survey.json")
