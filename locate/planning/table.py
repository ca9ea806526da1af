"""A plan as text and tables in the terminal."""

from collections.abc import Iterator

from rich.table import Table

from detect.registered.registration import WINDOW_PX
from locate.planning.plan import (
    MEASURED_FRAMES,
    MOST_FRAMES,
    NEEDED_PX,
    Level,
    Plan,
)

IN_A_FRAME = 0.9, 2.0
"""What single frames of simulated turbulent plumes showed, over what was planned (docs/plan.md)."""
PRECEDENTS: dict[str, tuple[tuple[float, str], ...]] = {
    "lossless": (
        (1.0, "20 of 20 simulated leaks of this strength were found"),
        (0.3, "19 of 20 simulated leaks of 0.3 px were found; on sharp photos 6 of 6"),
        (0.1, "19 of 20 simulated leaks of 0.1 px were found; on sharp photos 4 of 6"),
        (0.05, "none of 3 simulated leaks of 0.05 px was found"),
    ),
    "video": (
        (1.0, "simulated leaks of this strength were found; on real frames 4 of 6"),
        (0.3, "20 of 20 simulated leaks of 0.3 px were found in H.264, none of 6 on real frames"),
    ),
}
"""What was found at which strength, strongest first; docs/accuracy.md, docs/seeing.md,
docs/weak_plumes.md and docs/real_frames.md hold the commands."""


def precedent(plan: Plan) -> str:
    """What was found of plumes that were as strong, or a little weaker."""
    strength_px = plan.strength_px
    for least_px, words in PRECEDENTS[plan.coding]:
        if strength_px >= least_px:
            return words
    return "nothing as weak has been found"


def plan_rows(plan: Plan) -> Iterator[tuple[str, str]]:
    """What is planned: quantity and value."""
    view = plan.view
    yield (
        "frames as measured",
        f"{view.width}x{view.height} px, focal length {view.focal_px:.0f} px",
    )
    yield "lever", f"{view.lever_px / 1000:.3f} px per mrad"
    yield "n at the source, less the air's", f"{plan.source.index_difference(1.0):+.2e}"
    yield "strength", f"{plan.strength_px:.3f} px; {NEEDED_PX[plan.coding]:g} px are wanted"
    low, high = IN_A_FRAME
    yield "in a single frame", f"{low:g} to {high:g} times that, where the plume is turbulent"
    yield "so far", precedent(plan)
    yield "measure in", _measure_text(plan)
    yield (
        "walk round it",
        f"{plan.arc_deg:.0f} degrees, a way of {plan.path_m:.1f} m; keep {plan.path_frames} frames "
        "or more",
    )


def _measure_text(plan: Plan) -> str:
    frames = plan.measured_frames
    if frames is None:
        return f"more than {MOST_FRAMES} frames: too weak from there"
    if frames == MEASURED_FRAMES:
        return f"{frames} frames, as usual"
    return f"{frames} frames (--detection-frames), if noise falls with the root of their number"


def plan_table(plan: Plan) -> Table:
    """The plan."""
    table = Table(title="What this camera could see from there", title_justify="left")
    table.add_column("quantity")
    table.add_column("value", overflow="fold")
    for row in plan_rows(plan):
        table.add_row(*row)
    return table


def level_table(levels: list[Level]) -> Table:
    """The plume by height."""
    title = f"The plume by height (displacement as measured in a window of {WINDOW_PX:g} px)"
    table = Table(title=title, title_justify="left")
    for name in ("height, m", "radius, m", "radius, px", "of the source's fluid", "px displaced"):
        table.add_column(name, justify="right")
    for level in levels:
        table.add_row(
            f"{level.height_m:.2f}",
            f"{level.radius_m:.3f}",
            f"{level.radius_px:.1f}",
            f"{level.share:.0%}" if level.share >= 0.01 else f"{level.share:.2%}",
            f"{level.displacement_px:.3f}",
        )
    return table
