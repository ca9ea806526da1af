"""The cells as a GeoTIFF."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray
from geometry.georeference import Georeference
from locate.survey.cells import CellGrid
from locate.survey.model import Survey

EARTH_RADIUS_M = 6_371_000.0


def raster_notes() -> tuple[str, ...]:
    """The note where the raster cannot be written for want of the extra ``survey``."""
    try:
        missing = find_spec("rasterio") is None
    except ValueError:  # forbidden by a test
        missing = True
    what = "updraft.tif was left out: pip install 'plume-locate[survey]', then map anew"
    return (what,) if missing else ()


def write_raster(path: Path, survey: Survey, cells: CellGrid) -> None:
    """Writes float32 bands, north up, NaN where nothing was covered; each band has a description.

    The projection is a transverse Mercator about the survey's origin, true to scale at the
    origin's height: within a few kilometres its metres are those of the survey's frame.
    """
    import rasterio

    bands = _raster_bands(survey, cells)
    rows, columns = cells.shape
    cell_m = cells.cell_m
    west, south = (cells.low * cell_m).tolist()
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=columns,
        height=rows,
        count=len(bands),
        dtype="float32",
        nodata=np.nan,
        crs=raster_projection(survey.frame),
        transform=rasterio.Affine(cell_m, 0.0, west, 0.0, -cell_m, south + rows * cell_m),
        compress="deflate",
    ) as file:
        for number, (name, values) in enumerate(bands.items(), start=1):
            file.write(values[::-1].astype(np.float32), number)
            file.set_band_description(number, name)


def raster_projection(frame: Georeference) -> str:
    """The raster's reference system, named, as WKT 2."""
    from pyproj.crs import CRS, ProjectedCRS
    from pyproj.crs.coordinate_operation import TransverseMercatorConversion

    mercator = TransverseMercatorConversion(
        latitude_natural_origin=frame.lat_deg,
        longitude_natural_origin=frame.lon_deg,
        scale_factor_natural_origin=1 + frame.height_m / EARTH_RADIUS_M,
    )
    name = f"WGS 84 / Transverse Mercator about {frame.lat_deg:.6f}, {frame.lon_deg:.6f}"
    return ProjectedCRS(mercator, name=name, geodetic_crs=CRS("EPSG:4326")).to_wkt()


def _raster_bands(survey: Survey, cells: CellGrid) -> dict[str, FloatArray]:
    covered = cells.covered.sum(axis=0)
    mean, low, high = cells.overall_probability
    limit_px = np.where(np.isfinite(cells.limit_px), cells.limit_px, np.nan)
    bands = {
        "updraft probability": mean,
        "5 % quantile": low,
        "95 % quantile": high,
        "flights that looked": np.where(covered > 0, covered, np.nan),
        "flights that saw": np.where(covered > 0, cells.seen.sum(axis=0), np.nan),
        "detection limit, px": limit_px,
    }
    by_bin = {name: cells.in_bin(index) for index, name in enumerate(survey.bins)}
    return bands | {f"updraft probability, {name}": values for name, values in by_bin.items()}
