"""`locate survey` as a user types it, and a survey compared with a campaign's truth."""

import json
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from geometry.errors import BadInputError
from geometry.georeference import HeightDatum
from locate.commands.evaluate import evaluate
from locate.commands.survey import survey as command
from locate.simulation.campaign import SCHEMA, Campaign
from locate.survey import engine
from locate.survey.build import build_survey
from locate.survey.model import Survey, SurveySettings
from locate.survey.scoring import score_survey
from tests.locate.survey_runs import FIELD, Flown, write_run

SITES = np.array([[5.0, 10.0, 0.0], [-8.0, -15.0, 0.0], [10.0, -4.0, 0.0]])
STANDING = ([0, 1], [0, 2], [0, 1])
SETTINGS = SurveySettings(cell_m=4.0, wander_m=0.3)


def typed(function: Any, *arguments: object) -> str:
    app = typer.Typer()
    app.command()(function)
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def test_the_command_makes_a_survey_and_remembers_its_options(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "count_cores", lambda: 1)
    runs = [write_run(tmp_path, Flown(name=name, feet=SITES[:1])) for name in ("one", "two")]
    out = tmp_path / "out"
    printed = typed(command, runs[0], "-o", out, "--cell", 6, "--wander", 0.3)
    assert "map.html" in printed
    typed(command, runs[1], "-o", out, "--radius", 0.5)
    answer = Survey.load(out / "survey.json")
    assert len(answer.mapped) == 2
    assert (answer.settings.cell_m, answer.settings.wander_m) == (6.0, 0.3)
    assert answer.column.radius_m == 0.5
    assert (out / "log.jsonl").exists()


def write_campaign(root: Path) -> tuple[Path, list[Path]]:
    """The truth as `locate simulate` writes it, and runs that saw all of it without error."""
    flights = [
        {"name": f"flight_{i}", "start": datetime(2026, 7, 1 + i, 12), "wind_mps": (0.0, 0.0),
         "path": {"kind": "orbit"}}
        for i in range(len(STANDING))
    ]  # fmt: skip
    sites = [
        {"name": f"site {k}", "position": site.tolist(), "occurrence": {12.0: 0.7}}
        for k, site in enumerate(SITES)
    ]
    campaign = Campaign.model_validate({"kind": "campaign", "flights": flights, "sites": sites})
    folder = root / "campaign"
    folder.mkdir()
    campaign.save(folder / "campaign.yaml")
    place = replace(FIELD, datum=HeightDatum.ELLIPSOID)
    rows = [
        [
            {"site": f"site {k}", "on": k in standing, "probability": 0.7,
             "source": site.tolist() if k in standing else None}
            for k, site in enumerate(SITES)
        ]
        for standing in STANDING
    ]  # fmt: skip
    content = {
        "schema": SCHEMA,
        "origin": place.to_dict(),
        "flights": [
            {"name": flight["name"], "wind_mps": [0.0, 0.0], "columns": columns}
            for flight, columns in zip(flights, rows, strict=True)
        ],
    }
    (folder / "truth.json").write_text(json.dumps(content))
    runs = [
        write_run(root, Flown(name=str(flight["name"]), feet=SITES[standing]))
        for flight, standing in zip(flights, STANDING, strict=True)
    ]
    return folder, runs


def test_a_file_is_no_folder_for_a_survey(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    with pytest.raises(BadInputError, match="choose another folder with -o"):
        typed(command, tmp_path / "flight.mp4", "-o", tmp_path / "out")


def test_a_perfect_survey_scores_so(tmp_path: Path) -> None:
    truth, runs = write_campaign(tmp_path)
    score = score_survey(build_survey(runs, tmp_path / "out", settings=SETTINGS), truth)
    assert (score.sites, score.found, score.false, score.false_sightings) == (3, 3, 0, 0)
    assert max(score.errors_m) < 0.01
    assert max(score.single_errors_m) < 0.01
    assert score.single_found == pytest.approx(2 / 3)
    assert (score.standing, score.seen) == (6, 6)
    assert score.looks == 6
    assert score.chance == pytest.approx((0.7, 0.7, 0.7))
    printed = typed(evaluate, tmp_path / "out", "--truth", truth)
    assert "found by one flight" in printed
    as_json = json.loads(typed(evaluate, tmp_path / "out", "--truth", truth, "--json"))
    assert as_json["found"] == 3


def test_misses_and_inventions_are_counted(tmp_path: Path) -> None:
    truth, runs = write_campaign(tmp_path)
    invented = np.array([[-12.0, 25.0, 0.0]])
    spoilt = tmp_path / "spoilt"
    spoilt.mkdir()
    runs[1] = write_run(spoilt, Flown(name="flight_1", feet=invented))
    score = score_survey(build_survey(runs, tmp_path / "out", settings=SETTINGS), truth)
    assert (score.sites, score.found, score.false, score.false_sightings) == (3, 2, 1, 1)
    assert (score.standing, score.seen, score.looks) == (6, 4, 5)


def test_the_truth_of_something_else_is_refused(tmp_path: Path) -> None:
    truth, _ = write_campaign(tmp_path)
    other = tmp_path / "other"
    other.mkdir()
    answer = build_survey([write_run(other, Flown(name="stranger"))], tmp_path / "out")
    with pytest.raises(BadInputError, match="none of the flights"):
        score_survey(answer, truth)
    (truth / "truth.json").write_text('{"schema": "locate.truth/1"}')
    with pytest.raises(BadInputError, match="not the truth of a campaign"):
        score_survey(answer, truth)
