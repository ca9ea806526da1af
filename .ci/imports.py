"""Reads which package of the house imports which; `packages.py` draws it."""

import sys
from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from pathlib import Path

LAYERS = ("geometry", "detect", "locate")
"""The root packages, lowest first."""


@dataclass(frozen=True)
class Imports:
    """Who imports whom among packages and plain modules of the second level.

    Attributes:
        edges: What each of them imports.
        lines: Lines of code in each.
        packages: Those that are packages.
    """

    edges: dict[str, set[str]]
    lines: dict[str, int]
    packages: set[str]

    def reached(self, start: str) -> set[str]:
        """Everything that `start` imports, directly or through others."""
        found: set[str] = set()
        waiting = [start]
        while waiting:
            new = self.edges[waiting.pop()] - found
            found |= new
            waiting += new
        return found


def read_imports(root: Path) -> Imports:
    """Read the imports of the three packages below `root`; type-checking ones do not count."""
    sys.path.insert(0, str(root))
    import grimp

    graph = grimp.build_graph(*LAYERS, cache_dir=None, exclude_type_checking_imports=True)
    edges: dict[str, set[str]] = defaultdict(set)
    for module in graph.modules - set(LAYERS):
        own = second_level(module)
        imported = graph.find_modules_directly_imported_by(module) - set(LAYERS)
        edges[own] |= {second_level(other) for other in imported} - {own}
    files = {name: root / name.replace(".", "/") for name in edges}
    packages = {name for name, path in files.items() if path.is_dir()}
    lines = {
        name: sum(
            len(source.read_text(encoding="utf-8").splitlines())
            for source in (path.rglob("*.py") if name in packages else [path.with_suffix(".py")])
        )
        for name, path in files.items()
    }
    return Imports(dict(edges), lines, packages)


def second_level(module: str) -> str:
    """The package or module directly below the root package that `module` belongs to."""
    return ".".join(module.split(".")[:2])


def layer(name: str) -> int:
    """Which root package `name` belongs to, counted from the lowest."""
    return LAYERS.index(name.split(".", maxsplit=1)[0])


def find_cycles(imports: Imports) -> dict[str, frozenset[str]]:
    """The members of the cycle that each name is part of; alone where there is none."""
    reached = {name: imports.reached(name) for name in imports.edges}
    return {
        name: frozenset({name} | {other for other in reached[name] if name in reached[other]})
        for name in imports.edges
    }


def find_rows(imports: Imports) -> dict[str, int]:
    """The row of each name: its depth within its root package, above all rows of lower roots."""
    cycles = find_cycles(imports)

    @cache
    def depth(cycle: frozenset[str]) -> int:
        below = {
            cycles[other]
            for name in cycle
            for other in imports.edges[name]
            if layer(other) == layer(name)
        }
        return max((depth(other) + 1 for other in below - {cycle}), default=0)

    rows: dict[str, int] = {}
    for index in range(len(LAYERS)):
        start = max(rows.values(), default=-1) + 1
        rows |= {
            name: start + depth(cycles[name]) for name in imports.edges if layer(name) == index
        }
    return rows


def wrong_imports(imports: Imports) -> set[tuple[str, str]]:
    """Imports that are part of a cycle or point to a higher root package."""
    cycles = find_cycles(imports)
    return {
        (name, other)
        for name, imported in imports.edges.items()
        for other in imported
        if other in cycles[name] or layer(other) > layer(name)
    }


def describe(imports: Imports) -> str:
    """The same in words, to be compared: highest row first, then cycles and wrong imports."""
    rows = find_rows(imports)
    listed = []
    for name in sorted(imports.edges, key=lambda name: (-rows[name], name)):
        imported = " ".join(sorted(imports.edges[name])) or "nothing"
        listed.append(f"{rows[name]:>2} {name} ({imports.lines[name]:,} lines) <- {imported}")
    arrows = sum(map(len, imports.edges.values()))
    cycles = {members for members in find_cycles(imports).values() if len(members) > 1}
    listed.append(f"{len(imports.edges)} packages and modules, {arrows} arrows")
    listed.append(f"cycles: {'; '.join(' '.join(sorted(c)) for c in cycles) or 'none'}")
    upward = [f"{a} {b}" for a, b in sorted(wrong_imports(imports)) if layer(b) > layer(a)]
    listed.append(f"upward: {'; '.join(upward) or 'none'}")
    return "\n".join(listed)
