"""How the arc of the camera's path decides how well a source is placed in depth.

    python -m benchmarks.pictures arcs -o docs/images/arcs.svg

Prints the sigmas in depth and sideways of each arc.
Seen from above: a camera on an arc around a source, and the 2-sigma ellipse of the point that its
rays agree on. Four independent views, 8.5 m away, a focal length of 560 px, and an axis that is
measured to 8 px in each: bearings alone, so it says how the arc counts, not what a run reaches.
"""

import argparse
from html import escape
from pathlib import Path

import numpy as np

ARCS_DEG = (10, 20, 45, 90)
RANGE_M, FOCAL_PX, SIGMA_PX, VIEWS = 8.5, 560.0, 8.0, 4
PANEL_PX, SCALE_PX = 200, 15.0
"""Width of a panel, and px per metre."""


def source_sigmas_m(arc_deg: float) -> tuple[float, float]:
    """Of the source, in depth (towards the middle of the arc) and sideways."""
    angles = np.radians(np.linspace(-arc_deg / 2, arc_deg / 2, VIEWS))
    across = np.column_stack([np.cos(angles), -np.sin(angles)])
    information = across.T @ across / (RANGE_M * SIGMA_PX / FOCAL_PX) ** 2
    sideways, depth = np.sqrt(np.diag(np.linalg.inv(information)))
    return float(depth), float(sideways)


def panel(arc_deg: float, left: float) -> str:
    depth, sideways = source_sigmas_m(arc_deg)
    x, y = left + PANEL_PX / 2, 50.0
    angles = np.radians(np.linspace(-arc_deg / 2, arc_deg / 2, VIEWS))
    reach = RANGE_M * SCALE_PX
    ends = [(x + reach * np.sin(a), y + reach * np.cos(a)) for a in angles]
    rays = "".join(
        f'<line x1="{cx:.1f}" y1="{cy:.1f}" x2="{x}" y2="{y}" stroke="#9aa3ab"/>'
        f'<circle cx="{cx:.1f}" cy="{cy:.1f}" r="4" fill="#2b5f8a"/>'
        for cx, cy in ends
    )
    path = (
        f'<path d="M{ends[0][0]:.1f} {ends[0][1]:.1f}A{reach} {reach} 0 0 0 '
        f'{ends[-1][0]:.1f} {ends[-1][1]:.1f}" fill="none" stroke="#2b5f8a"/>'
    )
    ellipse = (
        f'<ellipse cx="{x}" cy="{y}" rx="{max(2 * sideways * SCALE_PX, 2):.1f}" '
        f'ry="{2 * depth * SCALE_PX:.1f}" fill="#d2452d" fill-opacity="0.55"/>'
    )
    words = (f"{arc_deg} degrees", f"depth {depth:.2f} m, sideways {sideways:.2f} m")
    lines = "".join(
        f'<text x="{x}" y="{y + 160 + 18 * i:.0f}" text-anchor="middle">{escape(line)}</text>'
        for i, line in enumerate(words)
    )
    return rays + path + ellipse + lines


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", type=Path, default=Path("work/arcs.svg"))


def main(options: argparse.Namespace) -> None:
    for arc in ARCS_DEG:
        depth, sideways = source_sigmas_m(arc)
        print(f"{arc:3} degrees: sigma {depth:.2f} m in depth, {sideways:.2f} m sideways")
    width, height = PANEL_PX * len(ARCS_DEG), 240
    body = "".join(panel(arc, PANEL_PX * i) for i, arc in enumerate(ARCS_DEG))
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
        f'height="{height}" font-family="sans-serif" font-size="12">'
        f'<rect width="100%" height="100%" fill="white"/>{body}</svg>\n',
        encoding="utf-8",
    )
