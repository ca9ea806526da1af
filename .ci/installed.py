"""What an installation brings: every file by its hash, or every package by its licence.

.ci/installed.py hashes|licences REPORT.json

The report is pip's; the licences are read from the packages, which must be installed.
"""

import json
import sys
from importlib.metadata import metadata
from pathlib import Path
from typing import Any

LONGEST = 40
"""Characters of a licence's name; longer ones are the licence itself."""


def hash_lines(packages: list[dict[str, Any]]) -> list[str]:
    """Lines for `pip install --require-hashes -r`."""
    lines = []
    for package in packages:
        stated, file = package["metadata"], package["download_info"]["archive_info"]
        digest = file["hashes"]["sha256"]
        lines.append(f"{stated['name']}=={stated['version']} --hash=sha256:{digest}")
    return sorted(lines, key=str.lower)


def licence_lines(packages: list[dict[str, Any]]) -> list[str]:
    """A table of names and licences, as the packages state them."""
    names = sorted((package["metadata"]["name"] for package in packages), key=str.lower)
    return ["package,licence", *(f"{name},{licence_of(name)}" for name in names)]


def licence_of(name: str) -> str:
    """Its SPDX expression, or what else its metadata call it."""
    stated = metadata(name)
    if "License-Expression" in stated:
        return stated["License-Expression"]
    text = (stated["License"] or "UNKNOWN").strip()
    kinds = [kind for kind in stated.get_all("Classifier", []) if kind.startswith("License :: ")]
    if kinds and (text == "UNKNOWN" or len(text) > LONGEST):
        text = " and ".join(kind.split(" :: ")[-1] for kind in kinds)
    first = text.splitlines()[0].replace(",", ";")
    return first if len(text) <= LONGEST or kinds else f"its own text: {first}"


if __name__ == "__main__":
    what, report = sys.argv[1:]
    make = {"hashes": hash_lines, "licences": licence_lines}[what]
    found = json.loads(Path(report).read_text())["install"]
    print("\n".join(make([one for one in found if "archive_info" in one["download_info"]])))
