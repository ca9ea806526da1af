"""Styles of the layers of a GeoPackage, in the table that QGIS reads: symbols as QML."""

import sqlite3
from collections.abc import Mapping, Sequence
from itertools import pairwise
from xml.etree import ElementTree

TABLE = """
CREATE TABLE layer_styles (
  id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, f_table_catalog TEXT(256),
  f_table_schema TEXT(256), f_table_name TEXT(256), f_geometry_column TEXT(256),
  styleName TEXT(30), styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, description TEXT,
  owner TEXT(30), ui TEXT(30),
  update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')))
"""

Symbol = ElementTree.Element


def add_styles(file: sqlite3.Connection, styles: Mapping[str, str]) -> None:
    """Adds the default style of each layer.

    Args:
        file: From `locate.export.geopackage.new_geopackage`, with its layers.
        styles: QML by the name of the layer.
    """
    file.execute(TABLE)
    file.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier)"
        " VALUES ('layer_styles', 'attributes', 'layer_styles')"
    )
    file.executemany(
        "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name,"
        " f_geometry_column, styleName, styleQML, styleSLD, useAsDefault, description, owner)"
        " VALUES ('', '', ?, 'geom', ?, ?, '', 1, '', '')",
        [(layer, layer, qml) for layer, qml in styles.items()],
    )


def marker(color: str, size_mm: float) -> Symbol:
    """A circle with a white rim.

    Args:
        color: ``#rrggbb``.
        size_mm: Its diameter.
    """
    return _symbol(
        "marker", "SimpleMarker", name="circle", color=_rgba(color), size=f"{size_mm:g}",
        size_unit="MM", outline_color=_rgba("#ffffff"), outline_width="0.2",
    )  # fmt: skip


def line(color: str, width_mm: float) -> Symbol:
    """A plain line."""
    return _symbol(
        "line", "SimpleLine", line_color=_rgba(color), line_width=f"{width_mm:g}",
        line_width_unit="MM",
    )  # fmt: skip


def outline(color: str, width_mm: float) -> Symbol:
    """The edge of an area, which is not filled."""
    return _symbol(
        "fill", "SimpleFill", style="no", outline_color=_rgba(color), outline_style="solid",
        outline_width=f"{width_mm:g}", outline_width_unit="MM",
    )  # fmt: skip


def area(color: str, opacity: float) -> Symbol:
    """A filled area without an edge.

    Args:
        color: ``#rrggbb``.
        opacity: From 0 to 1.
    """
    return _symbol(
        "fill", "SimpleFill", style="solid", color=_rgba(color, opacity), outline_style="no"
    )


def single(symbol: Symbol, label: str | None = None) -> str:
    """QML of a layer whose features all look the same.

    Args:
        symbol: That of each feature.
        label: The field that is written beside it.
    """
    renderer = ElementTree.Element("renderer-v2", type="singleSymbol")
    _add_symbols(renderer, [symbol])
    return _qml(renderer, label)


def graduated(field: str, edges: Sequence[float], symbols: Sequence[Symbol]) -> str:
    """QML of a layer whose features look as a field of theirs is.

    Args:
        field: The field.
        edges: K + 1 ascending values.
        symbols: K, one between each two edges.
    """
    renderer = ElementTree.Element(
        "renderer-v2", type="graduatedSymbol", attr=field, graduatedMethod="GraduatedColor"
    )
    ranges = ElementTree.SubElement(renderer, "ranges")
    for number, (low, high) in enumerate(pairwise(edges)):
        ElementTree.SubElement(
            ranges, "range", lower=f"{low:.9g}", upper=f"{high:.9g}", symbol=str(number),
            label=f"{low:.2g} to {high:.2g}", render="true",
        )  # fmt: skip
    _add_symbols(renderer, symbols)
    return _qml(renderer, None)


def _symbol(kind: str, drawn_as: str, **properties: str) -> Symbol:
    symbol = ElementTree.Element("symbol", type=kind, alpha="1", clip_to_extent="1")
    layer = ElementTree.SubElement(symbol, "layer", enabled="1", locked="0")
    layer.set("class", drawn_as)
    layer.set("pass", "0")
    for key, value in properties.items():  # this form is read by every QGIS 3
        ElementTree.SubElement(layer, "prop", k=key, v=value)
    return symbol


def _add_symbols(renderer: ElementTree.Element, symbols: Sequence[Symbol]) -> None:
    parent = ElementTree.SubElement(renderer, "symbols")
    for number, symbol in enumerate(symbols):
        symbol.set("name", str(number))
        parent.append(symbol)


def _qml(renderer: ElementTree.Element, label: str | None) -> str:
    root = ElementTree.Element("qgis", version="3.22", labelsEnabled="0" if label is None else "1")
    root.set("styleCategories", "Symbology|Labeling")
    root.append(renderer)
    if label is not None:
        labeling = ElementTree.SubElement(root, "labeling", type="simple")
        settings = ElementTree.SubElement(labeling, "settings")
        style = ElementTree.SubElement(settings, "text-style", fieldName=label, fontSize="10")
        ElementTree.SubElement(style, "text-buffer", bufferDraw="1", bufferSize="0.8")
        ElementTree.SubElement(settings, "placement", placement="6", dist="1")
    return ElementTree.tostring(root, encoding="unicode")


def _rgba(color: str, opacity: float = 1.0) -> str:
    return ",".join(map(str, (*bytes.fromhex(color.removeprefix("#")), round(255 * opacity))))
