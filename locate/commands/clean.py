"""`locate clean`."""

from pathlib import Path
from typing import Annotated

import typer

from locate.commands.console import out

MB = 1e6


def clean(
    output: Annotated[Path, typer.Argument(help="A run folder.")],
    remove: Annotated[bool, typer.Option("--remove", help="Remove them.")] = False,
) -> None:
    """List what a run's map and report can do without; the next run makes it again."""
    from locate.pipeline.clean import list_dispensable, open_finished, remove_dispensable

    folder = open_finished(output)
    found = list_dispensable(folder)
    for one in found:
        out.print(f"{one.size / MB:9.1f} MB  {one.name}: {one.what}", soft_wrap=True)
    total = sum(one.size for one in found) / MB
    if remove:
        remove_dispensable(folder)
        out.print(f"Removed: {total:.1f} MB")
    else:
        out.print(f"{total:.1f} MB in all; --remove removes them", soft_wrap=True)
