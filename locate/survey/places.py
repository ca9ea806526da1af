"""Hotspots by latitude and longitude, for the writers that know plumes."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.covariance import standard_deviations
from locate.export.located import LocatedPlume, plumes_on_earth
from locate.map.plume import Plume, PlumeMap
from locate.survey.findings import Hotspot
from locate.survey.model import Survey


@dataclass(frozen=True, kw_only=True)
class LocatedHotspot(LocatedPlume):
    """A hotspot on the Earth; `plume` holds its place and covariance only."""

    hotspot: Hotspot

    @property
    def name(self) -> str:
        """For people."""
        return f"Hotspot {self.hotspot.id}"

    @property
    def sentence(self) -> str:
        """What a pilot wants to read beside the point."""
        total = self.hotspot.occurrence[0]
        east, north, _ = standard_deviations(self.plume.source_covariance)
        return (
            f"Seen by {total.seen:.0f} of {total.looked:.0f} flights that covered it; present with "
            f"probability {total.probability:.2f} ({total.low:.2f} to {total.high:.2f}); "
            f"1 sigma {east:.2g} m east, {north:.2g} m north; "
            f"{self.height_m:.1f} m above {self.datum.words}"
        )

    def properties(self) -> dict[str, Any]:
        """Plain values under the names of docs/survey.md."""
        spot, total = self.hotspot, self.hotspot.occurrence[0]
        east, north, up = standard_deviations(self.plume.source_covariance).tolist()
        return {
            "hotspot": spot.id,
            "height_m": self.height_m,
            "height_datum": str(self.datum),
            "sigma_east_m": east,
            "sigma_north_m": north,
            "sigma_up_m": up,
            "looked": total.looked,
            "seen": total.seen,
            "occurrence": total.probability,
            "occurrence_low": total.low,
            "occurrence_high": total.high,
            "probability": spot.probability,
            "displacement_px": spot.displacement_px,
            "axis_east": spot.axis[0],
            "axis_north": spot.axis[1],
            "axis_up": spot.axis[2],
        }


def located_hotspots(survey: Survey) -> list[LocatedHotspot]:
    """The hotspots of a survey, in its order."""
    answer = PlumeMap(
        units="m",
        gravity=True,
        detector=survey.settings.detector,
        version=survey.version,
        georeference=survey.frame.to_dict(),
        plumes=tuple(_as_plume(spot) for spot in survey.hotspots),
    )
    return [
        LocatedHotspot(**vars(place), hotspot=spot)
        for place, spot in zip(plumes_on_earth(answer), survey.hotspots, strict=True)
    ]


def _as_plume(spot: Hotspot) -> Plume:
    return Plume(
        id=spot.id,
        source=np.array(spot.position),
        source_covariance=np.array(spot.covariance),
        axis=np.array(spot.axis),
        axis_sigma_rad=0.0,
        extent_low=0.0,
        extent_high=0.0,
        radius_by_height=np.zeros((0, 2)),
        evidence_nats=0.0,
        probability=spot.probability,
        views=(),
        displacement_px=spot.displacement_px,
    )
