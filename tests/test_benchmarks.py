"""Benchmarks stand apart: they are run, never imported, and import no test."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FORBIDDEN = {
    "geometry": {"benchmarks", "tests"},
    "detect": {"benchmarks", "tests"},
    "locate": {"benchmarks", "tests"},
    "examples": {"benchmarks", "tests"},
    "tests": {"benchmarks"},
    "benchmarks": {"tests"},
}


def imported(path: Path) -> set[str]:
    """The root packages that a file imports, wherever in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize(("folder", "forbidden"), FORBIDDEN.items())
def test_imports(folder: str, forbidden: set[str]) -> None:
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    found = {str(path): imported(path) & forbidden for path in files}
    assert {path: names for path, names in found.items() if names} == {}


def test_they_compute_what_they_say() -> None:
    command = [sys.executable, "-m", "benchmarks.checks", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
