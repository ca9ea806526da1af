import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = (
    *sorted(ROOT.glob("*.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted(ROOT.glob("detect/*/weights/*.md")),
)
COLUMNS = 100
URL = re.compile(r"\]\(([^)\s]+)\)")
TABLE_CODE_OR_IMAGE = re.compile(r"\s*\||    |!\[")

each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def prose_lines(page: Path) -> dict[int, str]:
    """The lines outside code blocks, tables and images, by number."""
    lines, fenced = {}, False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif not fenced and not TABLE_CODE_OR_IMAGE.match(line):
            lines[number] = line
    return lines


def heading_anchors(page: Path) -> set[str]:
    """The names that GitHub gives to the headings of a page."""
    headings = (line.lstrip("# ") for line in prose_lines(page).values() if line.startswith("#"))
    return {re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-") for text in headings}


@each_page
def test_no_line_of_prose_is_long(page: Path) -> None:
    without_urls = {n: URL.sub("]", line) for n, line in prose_lines(page).items()}
    assert [n for n, line in without_urls.items() if len(line) > COLUMNS] == []


@each_page
def test_links_lead_somewhere(page: Path) -> None:
    lost = []
    for target in URL.findall(page.read_text(encoding="utf-8")):
        name, _, anchor = target.partition("#")
        found = (page.parent / name).resolve() if name else page
        there = found.exists() and (not anchor or anchor in heading_anchors(found))
        if not there and not re.match(r"[a-z]+:", target):
            lost.append(target)
    assert lost == []
