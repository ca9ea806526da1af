"""What map.json must hold, schema ``locate.map/2``."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from geometry.errors import BadInputError
from geometry.georeference import HeightDatum
from geometry.json_values import check_fields
from locate.map.answer import Cause

SCHEMA = "locate.map/2"
EARLIER = ("locate.map/1",)
"""Read as well: the same without `answer` and `obstacles`."""

RefractiveIndex = Literal["lower", "higher"]

_Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
_Tangent = Annotated[list[FiniteFloat], Field(min_length=7, max_length=7)]


class _PlumeFile(BaseModel):
    id: int
    source: _Vector
    source_covariance: tuple[_Vector, _Vector, _Vector]
    axis: _Vector
    axis_sigma_rad: FiniteFloat
    extent_low: FiniteFloat
    extent_high: FiniteFloat
    radius_by_height: list[tuple[FiniteFloat, FiniteFloat]]
    evidence_nats: FiniteFloat
    probability: float = Field(ge=0, le=1)
    views: tuple[int, ...]
    displacement_px: FiniteFloat
    source_hidden: bool = False
    refractive_index: RefractiveIndex | None = None


class _BearingFile(BaseModel):
    direction_in_cam: _Vector
    sigma_rad: FiniteFloat
    evidence_nats: FiniteFloat
    probability: float = Field(ge=0, le=1)
    displacement_px: FiniteFloat


class _HazeFile(BaseModel):
    rms_px: float = Field(gt=0, allow_inf_nan=False)
    cells_px: tuple[tuple[Annotated[float, Field(ge=0, allow_inf_nan=False)] | None, ...], ...]


class _ObstacleFile(BaseModel):
    cause: Cause
    why: str
    remedy: str


class _TransformFile(BaseModel):
    scale: float = Field(gt=0)
    rotation_xyzw: tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]
    translation: _Vector


class _SourceFile(BaseModel):
    name: str
    unit: Literal["m", "deg", "%"]
    median_residual: FiniteFloat
    sigma: FiniteFloat
    count: int
    effective_count: FiniteFloat
    outliers: int


class _GeoreferenceFile(BaseModel):
    model_config = ConfigDict(extra="allow")

    origin_lat_deg: float = Field(ge=-90, le=90)
    origin_lon_deg: float = Field(ge=-180, le=180)
    origin_height_m: FiniteFloat
    height_datum: HeightDatum
    origin_name: str = "origin"
    enu_from_scene: _TransformFile | None = None
    covariance: Annotated[list[_Tangent], Field(min_length=7, max_length=7)] | None = None
    sources: tuple[_SourceFile, ...] = ()


class _MapFile(BaseModel):
    units: Literal["m", "scene"]
    gravity: bool
    detector: str
    version: str
    georeference: _GeoreferenceFile | None
    plumes: tuple[_PlumeFile, ...]
    bearings: tuple[_BearingFile, ...] = ()
    haze: _HazeFile | None = None
    detection_limit_px: FiniteFloat | None
    detection_limit_k: FiniteFloat | None = None
    obstacles: tuple[_ObstacleFile, ...] = ()
    notes: tuple[str, ...] = ()


_ARRAYS = {
    "source": (3,),
    "source_covariance": (3, 3),
    "axis": (3,),
    "radius_by_height": (-1, 2),
    "direction_in_cam": (3,),
}


def checked_fields(content: Any) -> dict[str, Any]:
    """The fields of a map, plumes and bearings as dicts with arrays.

    Raises:
        BadInputError: Another schema, a missing key, or a value of the wrong kind.
    """
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema not in (SCHEMA, *EARLIER):
        raise BadInputError(f"schema is {schema!r}, expected {SCHEMA!r}: make the map again")
    try:
        checked = check_fields(_MapFile, content)
    except ValueError as error:
        raise BadInputError(str(error)) from error
    fields = checked.model_dump()
    if checked.georeference is not None:
        fields["georeference"] = checked.georeference.model_dump(mode="json", exclude_unset=True)
    for group in ("plumes", "bearings"):
        fields[group] = [_with_arrays(item) for item in fields[group]]
    return fields


def _with_arrays(fields: dict[str, Any]) -> dict[str, Any]:
    return {
        name: np.reshape(np.asarray(value, dtype=float), _ARRAYS[name])
        if name in _ARRAYS
        else value
        for name, value in fields.items()
    }
