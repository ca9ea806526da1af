"""Where every command prints, and the options they share."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

out = Console()
err = Console(stderr=True)

Output = Annotated[Path, typer.Option("-o", "--output", help="The folder to write.")]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Say what each stage does.")]
Weights = Annotated[
    Path | None,
    typer.Option(
        help="Network of the dybs detector, e.g. from locate adapt; else the shipped one."
    ),
]
