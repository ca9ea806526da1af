"""`locate evaluate`."""

import json
from pathlib import Path
from typing import Annotated

import typer

from locate.commands.console import out


def evaluate(
    output: Annotated[Path, typer.Argument(help="A run folder.")],
    truth: Annotated[Path, typer.Option(help="The folder that `locate simulate` wrote.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Hold a map against the truth of a simulated scene."""
    from geometry.trajectory import Trajectory
    from locate.evaluate import evaluate as compare
    from locate.evaluate.table import evaluation_table
    from locate.plume import PlumeMap

    path = output / "trajectory.json"
    evaluation = compare(
        PlumeMap.load(output / "map.json"),
        Trajectory.load(path) if path.exists() else None,
        truth,
        output / "detections",
    )
    if as_json:
        typer.echo(json.dumps(evaluation.to_dict(), indent=1))
    else:
        out.print(evaluation_table(evaluation))
