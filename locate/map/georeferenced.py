"""A map on the Earth: its frame's own uncertainty goes into every plume."""

from dataclasses import replace

import numpy as np

from geometry.georeference import Alignment, Georeference
from locate.map.plume import Plume, PlumeMap


def georeference_map(
    plume_map: PlumeMap, alignment: Alignment, georeference: Georeference | None
) -> PlumeMap:
    """The map with the uncertainty of scale, rotation and origin in its plumes.

    The covariance of a source becomes its geometric part plus ``J C J^T`` of the alignment, and
    that of its axis likewise: the two are independent. What the alignment adds is common to all
    plumes of the map; the block keeps its covariance so that maps can be joined.

    Args:
        plume_map: Fused from a trajectory that `alignment` has already been applied to.
        alignment: What took the trajectory to local east-north-up.
        georeference: Where that frame sits on the Earth; None where no positions were known.
    """
    block = None
    if alignment.located and georeference is not None:
        block = georeference.to_dict() | alignment.to_dict()
    return replace(
        plume_map,
        plumes=tuple(_widen_covariance(plume, alignment) for plume in plume_map.plumes),
        georeference=block,
    )


def _widen_covariance(plume: Plume, alignment: Alignment) -> Plume:
    own = alignment.direction_sigma_rad(plume.axis)
    return replace(
        plume,
        source_covariance=plume.source_covariance + alignment.position_covariances(plume.source)[0],
        axis_sigma_rad=float(np.hypot(plume.axis_sigma_rad, own)),
    )
