"""The verdict as a table in the terminal."""

import math
from collections.abc import Iterator

from rich.table import Table

from locate.evaluation.evaluation import Evaluation

Row = tuple[str, str, str]


def evaluation_table(evaluation: Evaluation) -> Table:
    """Description, value and unit of everything that was compared."""
    caption = "; ".join(evaluation.notes)
    table = Table(title="Against the truth", title_justify="left", caption=caption or None)
    table.add_column("quantity")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for section in (_plume_rows(evaluation), _camera_rows(evaluation), _frame_rows(evaluation)):
        for row in section:
            table.add_row(*row)
        table.add_section()
    return table


def _unit_text(evaluation: Evaluation) -> str:
    return "m" if evaluation.units == "m" else "scene units"


def _plume_rows(evaluation: Evaluation) -> Iterator[Row]:
    unit = _unit_text(evaluation)
    for plume in evaluation.plumes:
        name = f"plume {plume.plume}"
        yield f"{name}: source error", f"{plume.error:.3f}", unit
        yield f"{name}: of range", f"{plume.error_percent:.2f}", "%"
        yield f"{name}: NEES, 3 expected", f"{plume.nees:.2f}", ""
        yield f"{name}: axis error", f"{plume.axis_error_deg:.1f}", "deg"
    for bearing in evaluation.bearings:
        name = f"bearing {bearing.bearing + 1}"
        yield f"{name}: error", f"{bearing.error_deg:.2f}", "deg"
        yield f"{name}: error over its sigma", f"{bearing.sigmas:.1f}", ""
    yield "missed plumes", f"{len(evaluation.misses)}", ""
    yield "false plumes", f"{len(evaluation.false_plumes)}", ""


def _camera_rows(evaluation: Evaluation) -> Iterator[Row]:
    alignment = evaluation.alignment
    if alignment is None:
        return
    yield "frames in common", f"{alignment.frames}", ""
    yield "scale, truth over map", f"{alignment.truth_from_map.scale:.4f}", ""
    yield "camera position rmse", f"{alignment.position_rmse:.4f}", _unit_text(evaluation)
    yield "camera rotation median", f"{alignment.rotation_median_deg:.3f}", "deg"


def _frame_rows(evaluation: Evaluation) -> Iterator[Row]:
    if not evaluation.frames:
        return
    median = evaluation.frame_median
    yield "frames scored", f"{len(evaluation.frames)}", ""
    if math.isnan(median("auroc")):
        yield "frames that show a plume", "0", ""
        return
    yield "evidence AUROC, median", f"{median('auroc'):.3f}", ""
    yield "evidence AP, median", f"{median('average_precision'):.3f}", ""
    yield "share of the mask, median", f"{median('prior'):.3f}", ""
    yield "displacement error in the mask, median", f"{median('epe_px'):.3f}", "px"
    yield "the same for an answer of zero", f"{median('epe_of_zero_px'):.3f}", "px"
