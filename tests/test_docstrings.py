"""Docstrings name arguments that are taken, and members and modules that exist."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("geometry", "detect", "locate", "benchmarks")
FILES = [path for name in PACKAGES for path in sorted((ROOT / name).rglob("*.py"))]
REFERENCE = re.compile(r"(?<!`)`([A-Za-z_]\w*(?:\.\w+)+)(?:\(.*?\))?`(?!`)")
SECTION = re.compile(r"^Args:\n((?: {4}.*\n?|\n)+)", re.MULTILINE)
Function = ast.FunctionDef | ast.AsyncFunctionDef


def names_in(tree: ast.AST) -> Iterator[str]:
    """Everything that is defined, imported, assigned or annotated below a node."""
    for node in ast.walk(tree):
        if isinstance(node, Function | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.alias):
            yield node.asname or node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def documented_arguments(node: ast.AST) -> set[str]:
    """The arguments that a docstring describes."""
    section = SECTION.search(ast.get_docstring(node) or "")
    return set(re.findall(r"^ {4}(\w+):", section[1], re.MULTILINE)) if section else set()


def arguments_of(node: Function) -> set[str]:
    """The arguments that a function takes."""
    taken = node.args
    every = [*taken.posonlyargs, *taken.args, *taken.kwonlyargs, taken.vararg, taken.kwarg]
    return {argument.arg for argument in every if argument is not None}


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    """Every module by its dotted name."""
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): ast.parse(
            path.read_text(encoding="utf-8")
        )
        for path in FILES
    }


def test_arguments_are_those_that_are_taken(trees: dict[str, ast.Module]) -> None:
    strange = []
    for module, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, Function):
                unknown = documented_arguments(node) - arguments_of(node)
            elif isinstance(node, ast.ClassDef):
                made = [f for f in node.body if isinstance(f, Function) and f.name == "__init__"]
                unknown = documented_arguments(node) - arguments_of(made[0]) if made else set()
            else:
                continue
            strange += [f"{module}: {node.name}: {name}" for name in sorted(unknown)]
    assert strange == []


def test_references_lead_somewhere(trees: dict[str, ast.Module]) -> None:
    members: defaultdict[str, set[str]] = defaultdict(set)
    everything: set[str] = set()
    for tree in trees.values():
        everything.update(names_in(tree))
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                members[node.name].update(names_in(node))
    strange = []
    for module, path in zip(trees, FILES, strict=True):
        for reference in REFERENCE.findall(path.read_text(encoding="utf-8")):
            *owner, name = reference.split(".")
            if owner[-1] in members:
                known = name in members[owner[-1]]
            elif owner[0] in PACKAGES:
                parent = ".".join(owner)
                known = reference in trees or (parent in trees and name in names_in(trees[parent]))
            else:
                known = owner[-1].islower() or owner[-1] in everything
            if not known:
                strange.append(f"{module}: {reference}")
    assert strange == []
