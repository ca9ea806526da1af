"""Where every command prints, and the options they share."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from geometry.printable import printable_lines


class PlainConsole(Console):
    """Prints texts as they are: what looks like markup, emoji or control is of a file's name."""

    def render_str(self, text: str, **options: Any) -> Text:
        """A text without markup and emoji, and with its control characters escaped."""
        plain = {**options, "markup": False, "emoji": False}
        return super().render_str(printable_lines(text), **plain)


out = PlainConsole()
err = PlainConsole(stderr=True)

Output = Annotated[Path, typer.Option("-o", "--output", help="The folder to write.")]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Say what each stage does.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print nothing but errors.")]
WEIGHTS = "Network of the dybs detector, e.g. from locate adapt; else the shipped one."
Weights = Annotated[Path | None, typer.Option(help=WEIGHTS)]
