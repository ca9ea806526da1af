"""A survey as files for people and for other programs."""

import json
from pathlib import Path

from geometry.atomic import atomic_path
from locate.export.geojson import collection_of
from locate.export.waypoints import write_cup_places, write_gpx_places
from locate.survey.cells import CellGrid
from locate.survey.layers import write_layers
from locate.survey.model import Survey
from locate.survey.page import write_map_page
from locate.survey.places import located_hotspots
from locate.survey.raster import raster_notes, write_raster

RASTER = "updraft.tif"


def publish_survey(output: Path, survey: Survey, cells: CellGrid | None) -> None:
    """Writes map.html, survey.gpkg, updraft.tif and the hotspots as GeoJSON, CUP and GPX.

    Without the extra ``survey`` there is no raster; see `raster_notes`.
    """
    places = located_hotspots(survey)
    with atomic_path(output / "hotspots.geojson") as path:
        path.write_text(json.dumps(collection_of(places), indent=1, allow_nan=False))
    with atomic_path(output / "hotspots.cup") as path:
        write_cup_places(path, places)
    with atomic_path(output / "hotspots.gpx") as path:
        write_gpx_places(path, places)
    with atomic_path(output / "survey.gpkg") as path:
        write_layers(path, survey, cells)
    (output / RASTER).unlink(missing_ok=True)
    if cells is not None and not raster_notes():
        with atomic_path(output / RASTER) as path:
            write_raster(path, survey, cells)
    with atomic_path(output / "map.html") as path:
        write_map_page(path, survey, cells)
