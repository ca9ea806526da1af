"""The answer of a survey as a table in the terminal."""

import numpy as np
from rich.table import Table

from locate.survey.model import Survey
from locate.survey.places import located_hotspots


def survey_table(survey: Survey) -> Table:
    """A row for every hotspot."""
    count = len(survey.hotspots)
    spots = "1 hotspot" if count == 1 else f"{count} hotspots"
    title = f"{spots}, {len(survey.mapped)} of {len(survey.flights)} flights"
    table = Table(title=title, title_justify="left")
    for name in ("hotspot", "latitude", "longitude", "sigma, m", "seen", "covered", "probability"):
        table.add_column(name, justify="right")
    for place in located_hotspots(survey):
        total = place.hotspot.occurrence[0]
        sigma = float(np.sqrt(np.trace(place.plume.source_covariance[:2, :2]) / 2))
        table.add_row(
            str(place.hotspot.id),
            f"{place.lat_deg:.6f}",
            f"{place.lon_deg:.6f}",
            f"{sigma:.2f}",
            f"{total.seen:.0f}",
            f"{total.looked:.0f}",
            f"{total.probability:.2f} ({total.low:.2f} to {total.high:.2f})",
        )
    return table
