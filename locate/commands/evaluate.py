"""`locate evaluate`."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from locate.commands.console import out


def evaluate(
    output: Annotated[Path, typer.Argument(help="A run folder, or that of a survey.")],
    truth: Annotated[Path, typer.Option(help="The folder that `locate simulate` wrote.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Hold a map against the truth of a simulated scene, a survey against a campaign's."""
    if (output / "survey.json").exists():
        _evaluate_survey(output, truth, as_json=as_json)
        return
    from locate.evaluation.api import evaluate as evaluate_run
    from locate.evaluation.table import evaluation_table

    evaluation = evaluate_run(output, truth)
    if as_json:
        typer.echo(json.dumps(evaluation.to_dict(), indent=1))
    else:
        out.print(evaluation_table(evaluation))


def _evaluate_survey(output: Path, truth: Path, *, as_json: bool) -> None:
    from locate.survey.model import Survey
    from locate.survey.scoring import score_survey, score_table

    score = score_survey(Survey.load(output / "survey.json"), truth)
    if as_json:
        typer.echo(json.dumps(asdict(score), indent=1))
    else:
        out.print(score_table(score))
