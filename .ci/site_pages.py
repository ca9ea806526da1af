"""For mkdocs: a line that is nothing but a link to a .csv becomes its table, folded."""

import csv
import re
from pathlib import Path
from posixpath import dirname, join, normpath
from typing import Any

TABLE = re.compile(r"^\[([^\]]+)\]\(([^)\s]+\.csv)\)$", re.MULTILINE)


def on_page_markdown(markdown: str, *, page: Any, config: Any, **_: Any) -> str:
    """The text of a page as the site shows it."""
    folder = dirname(page.file.src_uri)

    def table(found: re.Match[str]) -> str:
        path = Path(config.docs_dir, normpath(join(folder, found[2])))
        with path.open(encoding="utf-8", newline="") as file:
            head, *rows = csv.reader(file)
        lines = (f"    | {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows])
        return f'??? note "{found[1]}"\n\n' + "\n".join(lines) + "\n"

    return TABLE.sub(table, markdown)
