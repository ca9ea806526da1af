"""Scale, rotation and place on the Earth, from whatever there is, with its uncertainty."""

from geometry.georeference.alignment import Alignment, SourceReport
from geometry.georeference.constraints import (
    Constraint,
    PositionConstraint,
    ScaleConstraint,
    UpConstraint,
)
from geometry.georeference.fit import fit_similarity
from geometry.georeference.geodesy import Georeference, HeightDatum

__all__ = [
    "Alignment",
    "Constraint",
    "Georeference",
    "HeightDatum",
    "PositionConstraint",
    "ScaleConstraint",
    "SourceReport",
    "UpConstraint",
    "fit_similarity",
]
