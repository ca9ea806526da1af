"""Settings of a run: as options, and as the file that a run writes."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner, Result

from geometry.errors import BadInputError
from locate.commands import run as run_command
from locate.commands.app import app
from locate.pipeline.config import RunConfig, read_settings
from locate.pipeline.effort import EFFORTS
from locate.pipeline.run_folder import RunFolder

OF_THE_COMMAND = {"output", "config", "force", "as_json", "quiet", "verbose", "help", "jobs"}
"""Options of `locate run` that change nothing of the map."""


def options() -> dict[str, Any]:
    """The options of `locate run` by name, without what they are about."""
    command = get_command(app).commands["run"]
    return {one.name: one for one in command.params if one.name not in OF_THE_COMMAND}


def option_of(setting: str) -> str:
    return re.sub("_(px|s|m)$", "", setting)


def test_every_setting_is_an_option_and_every_option_a_setting() -> None:
    assert set(options()) == {option_of(name) for name in RunConfig.model_fields}


def test_the_example_of_a_group_uses_its_options() -> None:
    groups = {one.rich_help_panel for one in options().values()} - {None}
    assert len(groups) == 5
    for group in groups:
        named = {name.replace("-", "_") for name in re.findall(r"--([a-z-]+)", group)}
        assert named
        assert {options()[name].rich_help_panel for name in named} == {group}


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[RunConfig]:
    """The configurations of the runs that were started; none does anything."""
    asked: list[RunConfig] = []
    monkeypatch.setattr(run_command, "_run", lambda config, *_, **__: asked.append(config))
    return asked


def typed(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["run", *map(str, arguments)])


FULL = RunConfig(
    recording=Path("film.mp4"),
    detector="registered-plain",
    focal_px=1450,
    telemetry_offset_s=-0.5,
    shot=2,
    max_frames=60,
    max_side=1920,
    effort="thorough",
    neighbours=12,
    seed=3,
)


def test_what_a_run_wrote_another_reads(tmp_path: Path, started: list[RunConfig]) -> None:
    RunFolder(tmp_path / "out").save_config(FULL.to_plain())
    written = tmp_path / "out" / "config.yaml"
    assert typed("--config", written, "-o", tmp_path / "again").exit_code == 0
    result = typed("other.mp4", "--config", written, "--seed", 4, "-o", tmp_path / "again")
    assert result.exit_code == 0
    changed = {"recording": Path("other.mp4"), "seed": 4}
    assert started == [FULL, FULL.model_copy(update=changed)]


def test_options_become_settings(started: list[RunConfig]) -> None:
    result = typed(
        *("film.mp4", "-o", "out", "--detector", "registered-plain", "--focal", 1450),
        *("--telemetry-offset", -0.5, "--shot", 2, "--max-frames", 60, "--max-side", 1920),
        *("--effort", "thorough", "--neighbours", 12, "--seed", 3),
    )
    assert result.exit_code == 0, result.output
    assert started == [FULL]


def test_effort_decides_what_is_not_given(tmp_path: Path, started: list[RunConfig]) -> None:
    thorough = FULL.amounts
    assert (thorough.max_frames, thorough.max_side, thorough.neighbours) == (60, 1920, 12)
    assert thorough.detection_frames == EFFORTS["thorough"].detection_frames
    RunFolder(tmp_path / "out").save_config(FULL.to_plain())
    written = tmp_path / "out" / "config.yaml"
    typed("--config", written, "--effort", "quick", "-o", tmp_path / "again")
    assert started[0].amounts == replace(thorough, detection_frames=10, displacement_frames=0)
    assert RunConfig(recording=Path("film.mp4")).amounts == EFFORTS["usual"]


def test_without_a_recording_it_says_what_to_give(started: list[RunConfig]) -> None:
    result = typed("-o", "out")
    assert isinstance(result.exception, BadInputError)
    assert "--config FILE" in str(result.exception)
    assert not started


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("max_frame: 60", r"no setting is called max_frame; did you mean max_frames"),
        ("12: 60", r"no setting is called 12; they are recording, detector"),
        ("max_frames: 1", r"setting max_frames: Input should be greater than or equal to 2"),
        ("seed: -1", r"setting seed: Input should be greater than or equal to 0"),
        ("schema: locate.run/9", r"written as locate\.run/9, this program reads locate\.run/1"),
        ("- max_frames", r"no settings; write lines such as `max_frames: 60`"),
        ("a: [", r"not YAML \("),
    ],
)
def test_settings_that_cannot_be_used_are_one_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(BadInputError, match=rf"mine\.yaml: {says}") as error:
        read_settings(path)
    assert "\n" not in str(error.value)


def test_the_shell_completes_options(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = {
        "_LOCATE_COMPLETE": "complete_bash",
        "COMP_WORDS": "locate run --max",
        "COMP_CWORD": "2",
    }
    result = CliRunner().invoke(app, [], env=asked, prog_name="locate")
    assert result.output.split() == ["--max-frames", "--max-side"]
