"""Pages of one style: each is one file of HTML that works without a network."""

from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from types import MappingProxyType


def resource_path(name: str) -> Path:
    """Where a file or a folder of the package's data is."""
    return Path(str(files("locate"))) / "data" / name


def read_resource(name: str) -> str:
    """The text of a file of the package's data."""
    return resource_path(name).read_text(encoding="utf-8")


def write_page(
    path: Path,
    part: str,
    *,
    kind: str,
    headline: str,
    lead: str,
    facts: Iterable[tuple[str, str]],
    fragments: Mapping[str, str],
    scripts: Sequence[str] = (),
    data: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Writes a page: the frame and the style that all share, around a body of its own.

    Args:
        path: The file.
        part: Folder of the data that holds the page's own body.html and style.css.
        kind: What sort of page it is; as all that follows, not yet escaped.
        headline: The answer in a few words.
        lead: The answer in a sentence or two.
        facts: Name and value of what a reader wants to know first.
        fragments: HTML for the places in the body.
        scripts: JavaScript, the only one that the page's content-security policy lets run.
        data: JSON by the name of its element, for the scripts.
    """
    scripts = [one.replace("\r\n", "\n") for one in scripts]  # as browsers read and hash them
    page = Template(read_resource("page/page.html")).substitute(
        style=read_resource("page/style.css") + read_resource(f"{part}/style.css"),
        kind=escape(kind),
        headline=escape(headline),
        lead=escape(lead),
        facts="".join(
            f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in facts
        ),
        body=Template(read_resource(f"{part}/body.html")).substitute(fragments),
        allowed=" ".join(map(_policy_hash, scripts)) or "'none'",
        scripts="\n".join(
            [
                f'<script type="application/json" id="{name}">{_inside_script(text)}</script>'
                for name, text in data.items()
            ]
            + [f"<script>{script}</script>" for script in scripts]
        ),
    )
    path.write_text(page, encoding="utf-8")


def _policy_hash(script: str) -> str:
    """What names a script in a content-security policy."""
    return f"'sha256-{b64encode(sha256(script.encode()).digest()).decode()}'"


def _inside_script(json_text: str) -> str:
    """JSON that does not end the element around it."""
    return json_text.replace("<", "\\u003c")


def list_items(sentences: Iterable[str]) -> str:
    """Items of a list, each sentence once."""
    return "".join(f"<li>{escape(sentence)}</li>" for sentence in dict.fromkeys(sentences))


def definition_rows(settings: Iterable[tuple[str, object]]) -> str:
    """Rows of a table of names and values."""
    return "".join(
        f'<tr><th scope="row">{escape(name)}</th><td>{escape(str(value))}</td></tr>'
        for name, value in settings
    )


def html_table(
    heads: Sequence[str], rows: Iterable[Sequence[str]], *, named_rows: bool = False
) -> str:
    """A table that scrolls sideways where it is too wide.

    Args:
        heads: Of the columns.
        rows: The cells.
        named_rows: The first cell of a row is its head.
    """
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in heads)
    body = "".join(f"<tr>{_row_cells(row, named=named_rows)}</tr>" for row in rows)
    return (
        f'<div class="wide"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _row_cells(row: Sequence[str], *, named: bool) -> str:
    cells = [f"<td>{escape(value)}</td>" for value in row]
    if named:
        cells[0] = f'<th scope="row">{escape(row[0])}</th>'
    return "".join(cells)
