"""A release has one version wherever it is stated, and sends nobody to a placeholder."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

import locate

ROOT = Path(__file__).parents[1]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = SETTINGS["project"]
VERSIONS = {
    "pyproject.toml": r'^version = "(.+)"',
    "CITATION.cff": r"^version: (.+)",
    "CHANGELOG.md": r"^## (?:Unreleased\n[\s\S]*?^## )?(\d\S*)",
    "ros/locate_ros/package.xml": r"<version>(.+)</version>",
    "ros/locate_ros/setup.py": r'version="(.+)"',
}
SHOWN_TO_USERS = (
    *ROOT.glob("*.md"),
    *(ROOT / "docs").rglob("*.md"),
    *ROOT.glob(".github/ISSUE_TEMPLATE/*.yml"),
    *(ROOT / name for name in ("mkdocs.yml", "CITATION.cff")),
)


def stated(name: str, pattern: str) -> str:
    found = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
    assert found, f"{name} has no {pattern}"
    return found[1]


@pytest.mark.parametrize(("name", "pattern"), VERSIONS.items())
def test_version(name: str, pattern: str) -> None:
    assert stated(name, pattern) == locate.__version__


def test_what_builds_the_package_is_pinned() -> None:
    pinned = [
        Requirement(line)
        for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
        if not line.startswith("#")
    ]
    versions = {one.name: str(one.specifier).removeprefix("==") for one in pinned}
    for needed in map(Requirement, SETTINGS["build-system"]["requires"]):
        assert versions[needed.name] in needed.specifier


def test_address_that_is_a_placeholder_is_shown_to_nobody() -> None:
    address = PROJECT["urls"]["Source"].removeprefix("https://")
    assert [page for page in SHOWN_TO_USERS if address in page.read_text(encoding="utf-8")] == []


@pytest.mark.parametrize("form", sorted(ROOT.glob(".github/ISSUE_TEMPLATE/[!c]*.yml")))
def test_form_for_issues_asks_for_something(form: Path) -> None:
    content = yaml.safe_load(form.read_text(encoding="utf-8"))
    assert {"name", "description", "body"} <= content.keys()
    assert any(part["validations"]["required"] for part in content["body"] if "validations" in part)


def test_forge_runs_what_ci_runs() -> None:
    assert "run: bash .ci/run\n" in (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
