"""Draws the packages and their imports as one SVG; what imports nothing is at the bottom.

python .ci/packages.py [-o FILE.svg] [--text] [--root DIR]

A box is a package below geometry, detect or locate; plain modules of the same depth share a pale
box. An arrow that follows from others is left out. Red: cycles, and imports against the layers.
"""

import argparse
from collections import defaultdict
from dataclasses import dataclass, field
from functools import cache
from html import escape
from itertools import pairwise
from pathlib import Path

from imports import LAYERS, Imports, describe, find_rows, read_imports, wrong_imports

COLOURS = {"geometry": "#4c8c6b", "detect": "#b07d2b", "locate": "#3f6fa8"}
ROW, GAP, LETTER, MARGIN = 92, 26, 7.2, 70
"""Height of a row, space between boxes, width of a letter, border of the picture; pixels."""
SWEEPS = 24
"""Passes over the rows, down and up, that bring connected boxes closer; enough to settle."""


@dataclass(eq=False)
class Box:
    """A package, a group of plain modules, or (without labels) a bend of a long arrow."""

    root: str
    row: int
    labels: list[str] = field(default_factory=list)
    lines: int = 0
    is_package: bool = False
    x: float = 0.0

    @property
    def width(self) -> float:
        """Width in pixels."""
        return max((max(len(label), 9) * LETTER + 24 for label in self.labels), default=8.0)

    @property
    def height(self) -> float:
        """Height in pixels: a line of text per label, and one for the count of lines."""
        return 16.0 * len(self.labels) + 18 if self.labels else 0.0


def make_boxes(imports: Imports, rows: dict[str, int]) -> dict[str, Box]:
    """The box of each name; plain modules of a row share one."""
    boxes: dict[str, Box] = {}
    shared: dict[int, Box] = {}
    for name in sorted(imports.edges):
        root, label = name.split(".", maxsplit=1)
        if name in imports.packages:
            boxes[name] = Box(root, rows[name], is_package=True)
        else:
            boxes[name] = shared.setdefault(rows[name], Box(root, rows[name]))
        boxes[name].labels.append(label)
        boxes[name].lines += imports.lines[name]
    return boxes


def needed_arrows(imports: Imports, boxes: dict[str, Box]) -> set[tuple[Box, Box]]:
    """Arrows between boxes of different rows that no chain of other arrows already implies."""
    below: dict[Box, set[Box]] = defaultdict(set)
    for name, imported in imports.edges.items():
        lower = {boxes[other] for other in imported if boxes[other].row < boxes[name].row}
        below[boxes[name]] |= lower

    @cache
    def implied(box: Box) -> frozenset[Box]:
        return frozenset().union(*({other} | implied(other) for other in below[box]))

    return {
        (box, other)
        for box in set(boxes.values())
        for other in below[box]
        if not any(other in implied(between) for between in below[box])
    }


def bend_arrows(arrows: set[tuple[Box, Box]]) -> list[list[Box]]:
    """Each arrow as a chain of one box per row, with bends where it passes a row."""
    ordered = sorted(arrows, key=lambda pair: [(box.row, box.labels) for box in pair])
    return [
        [upper, *(Box(upper.root, row) for row in range(upper.row - 1, lower.row, -1)), lower]
        for upper, lower in ordered
    ]


def place_boxes(boxes: dict[str, Box], chains: list[list[Box]]) -> float:
    """Set the x of every box, bends too, so that chains run straight; the width of the picture."""
    rows: dict[int, list[Box]] = defaultdict(list)
    for box in dict.fromkeys([*boxes.values(), *(box for chain in chains for box in chain)]):
        rows[box.row].append(box)
    near: dict[Box, list[Box]] = defaultdict(list)
    for chain in chains:
        for upper, lower in pairwise(chain):
            near[upper].append(lower)
            near[lower].append(upper)
    for sweep in range(SWEEPS):
        for index in sorted(rows, reverse=sweep % 2 == 1):
            step = -1 if sweep % 2 == 0 else 1
            for box in rows[index]:
                seen = [other.x for other in near[box] if (other.row - index) * step > 0]
                box.x = sum(seen) / len(seen) if seen else box.x
            spread_row(rows[index])
    left = min(box.x - box.width / 2 for row in rows.values() for box in row)
    for box in (box for row in rows.values() for box in row):
        box.x += MARGIN - left
    return max(box.x + box.width / 2 for row in rows.values() for box in row) + MARGIN


def spread_row(row: list[Box]) -> None:
    """Push the boxes of a row apart, in order of x, around the middle that they had."""
    row.sort(key=lambda box: box.x)
    wanted = [box.x for box in row]
    for before, box in pairwise(row):
        box.x = max(box.x, before.x + (before.width + box.width) / 2 + GAP)
    shift = sum(x - box.x for x, box in zip(wanted, row, strict=True)) / len(row)
    for box in row:
        box.x += shift


def draw(imports: Imports) -> str:
    """The picture as the text of an SVG file."""
    boxes = make_boxes(imports, find_rows(imports))
    chains = bend_arrows(needed_arrows(imports, boxes))
    width = place_boxes(boxes, chains)
    count = max(box.row for box in boxes.values()) + 1
    tallest = [max(b.height for b in boxes.values() if b.row == row) for row in range(count)]
    middles, bottom = [], 40.0
    for height in tallest:
        middles.append(bottom + height / 2)
        bottom += height + ROW - 34
    total = bottom
    parts = [draw_band(root, list(boxes.values()), middles, width, total) for root in LAYERS]
    parts += [draw_chain(chain, middles, total) for chain in chains]
    parts += [
        draw_wrong(boxes[name], boxes[other], middles, total)
        for name, other in sorted(wrong_imports(imports))
    ]
    parts += [draw_box(box, middles, total) for box in dict.fromkeys(boxes.values())]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {total:.0f}" '
        f'width="{width:.0f}" height="{total:.0f}" font-family="sans-serif" font-size="13">\n'
        f"<defs>{marker('grey', '#9aa3ab')}{marker('red', '#d22')}</defs>\n"
        '<rect width="100%" height="100%" fill="white"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


def marker(name: str, colour: str) -> str:
    """The head of an arrow."""
    return (
        f'<marker id="{name}" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" '
        f'markerHeight="7" orient="auto"><path d="M0 0L8 4L0 8z" fill="{colour}"/></marker>'
    )


def draw_band(root: str, boxes: list[Box], middles: list[float], width: float, total: float) -> str:
    """The ground behind the boxes of a root package, with its name."""
    own = [box for box in boxes if box.root == root]
    top = min(total - middles[box.row] - box.height / 2 for box in own) - 27
    end = max(total - middles[box.row] + box.height / 2 for box in own) + 27
    colour = COLOURS[root]
    return (
        f'<rect x="6" y="{top:.0f}" width="{width - 12:.0f}" height="{end - top:.0f}" '
        f'fill="{colour}" fill-opacity="0.07"/><text x="20" y="{top + 30:.0f}" '
        f'font-size="22" font-weight="bold" fill="{colour}">{root}</text>'
    )


def draw_chain(chain: list[Box], middles: list[float], total: float) -> str:
    """A grey arrow from the bottom of the first box to the top of the last, through the bends."""
    heights = [total - middles[box.row] for box in chain]
    heights[0] += chain[0].height / 2
    heights[-1] -= chain[-1].height / 2
    path = f"M{chain[0].x:.0f} {heights[0]:.0f}"
    points = list(zip(chain, heights, strict=True))
    for (upper, high), (lower, low) in pairwise(points):
        half = (high + low) / 2
        path += f"C{upper.x:.0f} {half:.0f} {lower.x:.0f} {half:.0f} {lower.x:.0f} {low:.0f}"
    return f'<path d="{path}" fill="none" stroke="#9aa3ab" marker-end="url(#grey)"/>'


def draw_wrong(source: Box, target: Box, middles: list[float], total: float) -> str:
    """A red arc, over the tops of boxes in the same row, for an import that should not be."""
    start, end = (total - middles[box.row] - box.height / 2 for box in (source, target))
    over = min(start, end) - 44
    path = f"M{source.x:.0f} {start:.0f}C{source.x:.0f} {over:.0f} {target.x:.0f} {over:.0f} "
    path += f"{target.x:.0f} {end:.0f}"
    return f'<path d="{path}" fill="none" stroke="#d22" stroke-width="2" marker-end="url(#red)"/>'


def draw_box(box: Box, middles: list[float], total: float) -> str:
    """A box with its labels and its lines of code."""
    top = total - middles[box.row] - box.height / 2
    colour = COLOURS[box.root]
    fill, ink = (colour, "white") if box.is_package else ("#f4f4f2", "#333")
    texts = [*box.labels, f"{box.lines:,} lines"]
    spans = "".join(
        f'<tspan x="{box.x:.0f}" y="{top + 16 + 16 * index:.0f}"'
        + (' font-size="10">' if text is texts[-1] else ">")
        + f"{escape(text)}</tspan>"
        for index, text in enumerate(texts)
    )
    return (
        f'<rect x="{box.x - box.width / 2:.0f}" y="{top:.0f}" width="{box.width:.0f}" '
        f'height="{box.height:.0f}" rx="5" fill="{fill}" stroke="{colour}"/>'
        f'<text text-anchor="middle" fill="{ink}">{spans}</text>'
    )


def main() -> None:
    """Write the picture, print the words."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, metavar="FILE.svg")
    parser.add_argument("--text", action="store_true", help="print the same as words")
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[1])
    options = parser.parse_args()
    imports = read_imports(options.root.resolve())
    if options.output:
        options.output.write_text(draw(imports), encoding="utf-8")
    if options.text or not options.output:
        print(describe(imports))


if __name__ == "__main__":
    main()
