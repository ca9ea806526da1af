"""Counts what stands in the way of a reader: one-word names, shared class names, loose modules.

python .ci/names.py [--root DIR] [--list PACKAGE] [--most-duplicates N] [--most-loose N]
"""

import argparse
import ast
import re
import sys
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

PACKAGES = ("geometry", "detect", "locate")
ROOT_MODULES = {"__init__.py", "__main__.py", "cli.py"}
"""The modules that may stand at the root of `locate/`."""
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z0-9]+|[0-9]+")
"""One word of a name in snake_case or CamelCase; a run of capitals is one word."""


@dataclass(frozen=True)
class Name:
    """A function, method or class, and where it is defined."""

    text: str
    is_class: bool
    file: Path
    line: int

    @property
    def one_word(self) -> bool:
        """Whether the name is a single word, leading underscores aside."""
        return len(WORD.findall(self.text)) == 1


def package_names(root: Path, package: str) -> list[Name]:
    """The functions, methods and classes of a package below `root`, dunder methods left out."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    return [
        Name(node.name, isinstance(node, ast.ClassDef), path.relative_to(root), node.lineno)
        for path in sorted((root / package).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, kinds) and not (node.name.startswith("__") and node.name.endswith("__"))
    ]


def duplicate_classes(names: list[Name]) -> dict[str, list[Path]]:
    """Class names that are defined more than once, with the files that define them."""
    files = defaultdict(list)
    for name in names:
        if name.is_class:
            files[name.text].append(name.file)
    return {text: files[text] for text in sorted(files) if len(files[text]) > 1}


def loose_modules(root: Path) -> list[str]:
    """Modules at the root of `locate/` that belong in a package."""
    return sorted({path.name for path in (root / "locate").glob("*.py")} - ROOT_MODULES)


def list_one_word(names: list[Name]) -> None:
    """Print the one-word names with file and line."""
    for name in names:
        if name.one_word:
            print(f"{name.text:<24} {name.file}:{name.line}")


def print_counts(
    names: dict[str, list[Name]], duplicates: dict[str, list[Path]], loose: list[str]
) -> None:
    """Print the counts as a small table, then the duplicates and the loose modules by name."""
    every = [name for package in names.values() for name in package]
    print(f"{'':<12}{'names':>8}{'one word':>10}")
    for package, own in {**names, "all": every}.items():
        print(f"{package:<12}{len(own):>8,}{sum(name.one_word for name in own):>10,}")
    print(f"class names defined more than once: {len(duplicates)}")
    for text, files in duplicates.items():
        print(f"  {text}: {', '.join(map(str, files))}")
    print(f"loose modules in locate/: {len(loose)}")
    if loose:
        print(f"  {', '.join(loose)}")


def main() -> int:
    """Print the counts, or the list that was asked for; 1 where a limit is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[1])
    parser.add_argument("--list", metavar="PACKAGE", help="list the one-word names of a package")
    parser.add_argument("--most-duplicates", type=int, metavar="N", default=sys.maxsize)
    parser.add_argument("--most-loose", type=int, metavar="N", default=sys.maxsize)
    options = parser.parse_args()
    if options.list:
        list_one_word(package_names(options.root, options.list.replace(".", "/")))
        return 0
    names = {package: package_names(options.root, package) for package in PACKAGES}
    duplicates = duplicate_classes([name for package in names.values() for name in package])
    loose = loose_modules(options.root)
    print_counts(names, duplicates, loose)
    return int(len(duplicates) > options.most_duplicates or len(loose) > options.most_loose)


if __name__ == "__main__":
    sys.exit(main())
