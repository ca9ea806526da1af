"""How far a run is: its bar, what it prints when nobody looks, and where its answer goes."""

import io
import json
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from locate.commands.app import app
from locate.journal.progress import progress_bars
from locate.journal.whole_run import USUAL_S, RunProgress, run_bar
from locate.map.plume import PlumeMap
from locate.recording.sample import SAMPLE, SAMPLE_VIDEO


class Clock:
    """Tells the time that it was set to."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def go_through(run: RunProgress, clock: Clock, stages: list[str], times: float) -> list[float]:
    """The shares shown while these stages take `times` their usual seconds."""
    shown = []
    for stage in stages:
        for step in range(5):
            run.report(stage, step / 4)
            shown.append(run.share())
            clock.now_s += times * USUAL_S[stage] / 5
            shown.append(run.share())
    return shown


@pytest.mark.parametrize("times", [0.5, 1.0, 4.0])
def test_the_share_rises_all_the_way_and_the_time_left_is_right(times: float) -> None:
    clock = Clock()
    run = RunProgress(clock)
    half = go_through(run, clock, ["frames", "poses"], times)
    assert half == sorted(half)
    rest_s = sum(USUAL_S[stage] for stage in ("detections", "fusion", "report"))
    run.report("detections", 0.0)
    assert run.left_s() == pytest.approx(times * rest_s, rel=0.2)
    rest = go_through(run, clock, ["detections", "fusion", "report"], times)
    assert rest == sorted(rest)
    assert rest[-1] == pytest.approx(1)


def test_a_long_recording_does_not_make_the_other_stages_long() -> None:
    clock = Clock()
    run = RunProgress(clock)
    run.report("frames", 0.0)
    clock.now_s += 300
    run.report("frames", 0.5)
    later_s = sum(USUAL_S.values()) - USUAL_S["frames"]
    assert run.left_s() == pytest.approx(300 + later_s)


def test_the_bar_goes_on_between_two_reports_but_not_to_the_end() -> None:
    clock = Clock()
    run = RunProgress(clock)
    run.report("frames", 1.0)
    run.report("poses", 0.0)
    shown = []
    for _ in range(100):
        clock.now_s += 1
        shown.append(run.share())
    assert shown == sorted(set(shown))
    assert shown[-1] < 1


def test_stages_that_were_skipped_are_no_work() -> None:
    clock = Clock()
    run = RunProgress(clock)
    run.report("fusion", 0.0)
    assert run.share() == 0
    assert run.left_s() == pytest.approx(USUAL_S["fusion"] + USUAL_S["report"])
    assert (run.stage, run.number) == ("fusion", 4)


def printed(context: object, *, terminal: bool) -> str:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=terminal, width=120)
    with context(console) as report:  # type: ignore[operator]
        report("poses", 0.5)
    return stream.getvalue()


def test_the_bar_names_the_stage_and_the_time_left() -> None:
    said = printed(run_bar, terminal=True)
    assert "left of the run" in said
    assert "poses (2 of 5)" in said


@pytest.mark.parametrize("context", [run_bar, progress_bars])
def test_nothing_is_printed_where_nobody_looks(context: object) -> None:
    assert printed(context, terminal=False) == ""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of the sample's poses, short."""
    output = tmp_path_factory.mktemp("run") / "out"
    result = typed(output)
    assert result[0] == 0, result
    return output


def typed(output: Path, *options: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a run."""
    few = ("--max-frames", "8", "--detection-frames", "2")
    poses = ("--poses", str(SAMPLE / "truth.json"))
    done = CliRunner().invoke(
        app, ["run", str(SAMPLE_VIDEO), "-o", str(output), *few, *poses, *options]
    )
    return done.exit_code, done.stdout, done.stderr


def test_json_is_the_map_and_nothing_else(finished: Path) -> None:
    code, said, _ = typed(finished, "--json")
    assert code == 0
    assert json.loads(said) == json.loads((finished / "map.json").read_text())
    assert PlumeMap.load(finished / "map.json").to_dict() == json.loads(said)


def test_quiet_prints_nothing(finished: Path) -> None:
    assert typed(finished, "-q") == (0, "", "")


def test_verbose_names_the_stages(finished: Path) -> None:
    _, _, said = typed(finished, "-v")
    for stage in ("frames", "poses", "detections", "fusion", "report"):
        assert f"{stage}: skipped" in " ".join(said.split())


def test_quiet_and_verbose_exclude_each_other(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["run", str(SAMPLE_VIDEO), "-o", str(tmp_path), "-q", "-v"])
    assert "either -q or -v" in str(done.exception)
