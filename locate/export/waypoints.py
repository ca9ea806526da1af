"""The sources as waypoints: CUP for soaring software, GPX 1.1 for nearly everything else.

Both count heights from mean sea level. Where the map's heights cannot be turned into that, none is
written as such; the text beside the point gives it with its datum.
"""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from locate.export.located import LocatedPlume, plumes_on_earth
from locate.map.plume import PlumeMap

CUP_FIELDS = "name,code,country,lat,lon,elev,style,rwdir,rwlen,freq,desc"
CUP_STYLE_WAYPOINT = 1
GPX_NAMESPACE = "http://www.topografix.com/GPX/1/1"


def write_cup(path: Path, plume_map: PlumeMap) -> None:
    """Writes a SeeYou waypoint file; its positions are whole thousandths of a minute (1.9 m).

    Raises:
        ValueError: The map is not georeferenced.
    """
    write_cup_places(path, plumes_on_earth(plume_map))


def write_cup_places(path: Path, places: Sequence[LocatedPlume]) -> None:
    """Likewise of places by themselves."""
    lines = [CUP_FIELDS, *(_cup_line(one) for one in places), ""]
    path.write_text("\r\n".join(lines), encoding="utf-8", newline="")


def write_gpx(path: Path, plume_map: PlumeMap) -> None:
    """Writes a waypoint per source.

    Raises:
        ValueError: The map is not georeferenced.
    """
    write_gpx_places(path, plumes_on_earth(plume_map))


def write_gpx_places(path: Path, places: Sequence[LocatedPlume]) -> None:
    """Likewise of places by themselves."""
    root = ElementTree.Element("gpx", version="1.1", creator="plume-locate", xmlns=GPX_NAMESPACE)
    for one in places:
        point = ElementTree.SubElement(
            root, "wpt", lat=f"{one.lat_deg:.9f}", lon=f"{one.lon_deg:.9f}"
        )
        if one.sea_height_m is not None:
            ElementTree.SubElement(point, "ele").text = f"{one.sea_height_m:.3f}"
        ElementTree.SubElement(point, "name").text = one.name
        ElementTree.SubElement(point, "desc").text = one.sentence
        ElementTree.SubElement(point, "type").text = "plume"
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _cup_line(one: LocatedPlume) -> str:
    height = "" if one.sea_height_m is None else f"{one.sea_height_m:.1f}m"
    place = f"{_cup_angle(one.lat_deg, 'NS', 2)},{_cup_angle(one.lon_deg, 'EW', 3)},{height}"
    return f'"{one.name}","P{one.plume.id}",,{place},{CUP_STYLE_WAYPOINT},,,,"{one.sentence}"'


def _cup_angle(degrees: float, hemispheres: str, width: int) -> str:
    """``DDMM.mmmN``; rounded as a whole, so that 59.9996 minutes carry into the degree."""
    thousandths = round(abs(degrees) * 60_000)
    whole, rest = divmod(thousandths, 60_000)
    return f"{whole:0{width}d}{rest / 1000:06.3f}{hemispheres[degrees < 0]}"
