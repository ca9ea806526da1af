"""A release has one version and one address, wherever they are stated."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

import locate

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
VERSIONS = {
    "pyproject.toml": r'^version = "(.+)"',
    "CITATION.cff": r"^version: (.+)",
    "CHANGELOG.md": r"^## (?:Unreleased\n[\s\S]*?^## )?(\d\S*)",
    "ros/locate_ros/package.xml": r"<version>(.+)</version>",
    "ros/locate_ros/setup.py": r'version="(.+)"',
}
ADDRESSES = {
    "CITATION.cff": r"^repository-code: (\S+)",
    "mkdocs.yml": r"^repo_url: (\S+)",
    "docs/start.md": r"git clone (\S+)",
    "ros/locate_ros/package.xml": r'<url type="repository">(\S+)</url>',
    ".github/ISSUE_TEMPLATE/config.yml": r"url: (\S+)/security/advisories/new",
}


def stated(name: str, pattern: str) -> str:
    found = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
    assert found, f"{name} has no {pattern}"
    return found[1]


@pytest.mark.parametrize(("name", "pattern"), VERSIONS.items())
def test_version(name: str, pattern: str) -> None:
    assert stated(name, pattern) == locate.__version__


@pytest.mark.parametrize(("name", "pattern"), ADDRESSES.items())
def test_address(name: str, pattern: str) -> None:
    assert stated(name, pattern) == PROJECT["urls"]["Source"]


@pytest.mark.parametrize("form", sorted(ROOT.glob(".github/ISSUE_TEMPLATE/[!c]*.yml")))
def test_form_for_issues_asks_for_something(form: Path) -> None:
    content = yaml.safe_load(form.read_text(encoding="utf-8"))
    assert {"name", "description", "body"} <= content.keys()
    assert any(part["validations"]["required"] for part in content["body"] if "validations" in part)


def test_forge_runs_what_ci_runs() -> None:
    assert "run: bash .ci/run\n" in (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
