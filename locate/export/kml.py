"""The sources for Google Earth and its kin: KML, OGC 07-147r2 (version 2.2)."""

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from geometry.printable import printable_lines
from locate.export.located import LocatedPlume, plumes_on_earth
from locate.export.table import advice_lines
from locate.map.plume import PlumeMap

NAMESPACE = "http://www.opengis.net/kml/2.2"


def write_kml(path: Path, plume_map: PlumeMap) -> None:
    """Writes a placemark per source and the 95 % ellipse of each.

    KML counts an absolute altitude from mean sea level. Where the map's heights cannot be turned
    into that, points lie on the ground and the height is in their data, with its datum.

    Raises:
        ValueError: The map is not georeferenced.
    """
    kml = ElementTree.Element("kml", xmlns=NAMESPACE)
    document = ElementTree.SubElement(kml, "Document")
    _add_element(document, "name", "Plumes")
    _add_element(document, "description", "\n".join(_answer_lines(plume_map)))
    _add_style(document)
    for one in plumes_on_earth(plume_map):
        _add_source(document, one)
        _add_ellipse(document, one)
    ElementTree.indent(kml)
    ElementTree.ElementTree(kml).write(path, encoding="utf-8", xml_declaration=True)


def _answer_lines(plume_map: PlumeMap) -> Iterator[str]:
    yield plume_map.limit_text()
    yield from advice_lines(plume_map)
    yield from plume_map.notes


def _add_element(parent: ElementTree.Element, tag: str, text: str = "") -> ElementTree.Element:
    child = ElementTree.SubElement(parent, tag)
    child.text = printable_lines(text) or None
    return child


def _add_style(document: ElementTree.Element) -> None:
    style = ElementTree.SubElement(document, "Style", id="uncertainty")
    _add_element(_add_element(style, "LineStyle"), "color", "ff0000ff")
    _add_element(_add_element(style, "PolyStyle"), "color", "330000ff")


def _add_source(document: ElementTree.Element, one: LocatedPlume) -> None:
    placemark = _add_element(document, "Placemark")
    _add_element(placemark, "name", one.name)
    _add_element(placemark, "description", one.sentence)
    data = _add_element(placemark, "ExtendedData")
    for name, value in one.properties().items():
        item = ElementTree.SubElement(data, "Data", name=name)
        _add_element(item, "value", str(value))
    point = _add_element(placemark, "Point")
    place = f"{one.lon_deg:.9f},{one.lat_deg:.9f}"
    if one.sea_height_m is None:
        _add_element(point, "altitudeMode", "clampToGround")
        _add_element(point, "coordinates", place)
    else:
        _add_element(point, "altitudeMode", "absolute")
        _add_element(point, "coordinates", f"{place},{one.sea_height_m:.3f}")


def _add_ellipse(document: ElementTree.Element, one: LocatedPlume) -> None:
    placemark = _add_element(document, "Placemark")
    _add_element(placemark, "name", f"{one.name}, 95 %")
    _add_element(placemark, "styleUrl", "#uncertainty")
    polygon = _add_element(placemark, "Polygon")
    _add_element(polygon, "altitudeMode", "clampToGround")
    ring = _add_element(_add_element(polygon, "outerBoundaryIs"), "LinearRing")
    corners = (f"{lon:.9f},{lat:.9f}" for lon, lat in one.ellipse_lon_lat)
    _add_element(ring, "coordinates", " ".join(corners))
