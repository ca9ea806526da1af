import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.documented_commands import (
    blocks,
    calls,
    complaints,
    complaints_of_modules,
    inline_complaints,
    names_of_commands,
    unknown_imports,
)

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


FROM_ELSEWHERE = re.compile(r'<(?:script|img)[^>]*src="?https?:|<link[^>]*stylesheet[^>]*https?:')
INDENTED = re.compile(r"(?:^|\n)\n {4}(?:locate|python|pip|make) ")
HISTORY = {"CHANGELOG.md", "tried.md"}


@each_page
def test_commands_are_in_blocks_of_the_shell(page: Path) -> None:
    assert not INDENTED.search(page.read_text(encoding="utf-8"))


def test_commands_in_blocks_are_understood(tmp_path: Path) -> None:
    wrong: list[str] = []
    modules: list[list[str]] = []
    for page in PAGES:
        for block in blocks(page, "sh"):
            for call in calls(block.text, tmp_path):
                wrong += [f"{page.name}: {text}" for text in complaints(call, modules)]
    assert modules
    assert wrong + complaints_of_modules(modules) == []


@each_page
def test_commands_in_sentences_name_what_there_is(page: Path) -> None:
    if page.name not in HISTORY:
        assert inline_complaints(page) == []


def test_every_command_is_on_the_page_to_start_from() -> None:
    named = set(re.findall(r"`locate ([a-z]+)", (ROOT / "docs/start.md").read_text("utf-8")))
    assert names_of_commands() - named == set()


@each_page
def test_programs_import_what_there_is(page: Path) -> None:
    programs = list(blocks(page, "python"))
    assert [name for block in programs for name in unknown_imports(block.text)] == []


def test_what_is_marked_to_be_run_does(tmp_path: Path) -> None:
    found = [block for page in PAGES for name in ("sh", "python") for block in blocks(page, name)]
    found = [block for block in found if block.run]
    assert {block.language for block in found} == {"sh", "python"}
    program = tmp_path / "locate"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m locate "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    environment["PYTHONPATH"] = str(ROOT)
    by = {"sh": ["/bin/bash", "-euc"], "python": [sys.executable, "-c"]}
    for number, block in enumerate(found):
        work = tmp_path / str(number)
        work.mkdir()
        (work / "examples").symlink_to(ROOT / "examples")
        done = subprocess.run(
            [*by[block.language], block.text],
            cwd=work,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{block.text}\n{done.stdout}{done.stderr}"


def test_site_is_built_without_a_warning(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "plume_map" in (tmp_path / "site/api/locate.html").read_text(encoding="utf-8")
    for page in (tmp_path / "site").rglob("*.html"):
        assert not FROM_ELSEWHERE.search(page.read_text(encoding="utf-8")), page
