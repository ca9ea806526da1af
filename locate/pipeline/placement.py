"""What took a reconstruction to the world of the map."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.georeference import Alignment, Georeference
from geometry.text_files import read_json
from geometry.trajectory import Trajectory
from locate.map.georeferenced import georeference_map
from locate.map.plume import PlumeMap


@dataclass(frozen=True, kw_only=True)
class Placement:
    """What took the reconstruction to local east-north-up, or as much of it as is known.

    Attributes:
        alignment: The similarity and its covariance; None where nothing was known.
        georeference: Where that frame sits on the Earth; None without positions.
        notes: What the reader of the map should know of it.
    """

    alignment: Alignment | None = None
    georeference: Georeference | None = None
    notes: tuple[str, ...] = ()

    def apply(self, trajectory: Trajectory) -> Trajectory:
        """The cameras in the new frame."""
        if self.alignment is None:
            return trajectory
        placed = trajectory.transformed(self.alignment.target_from_source)
        return replace(
            placed,
            metric=trajectory.metric or self.alignment.metric,
            gravity=trajectory.gravity or self.alignment.gravity,
        )

    def apply_to_points(self, points_in_world: FloatArray) -> FloatArray:
        """(M, 3) points in the new frame."""
        if self.alignment is None:
            return points_in_world
        return self.alignment.target_from_source(points_in_world)

    def with_uncertainty(self, plume_map: PlumeMap) -> PlumeMap:
        """A map made in the new frame, with that frame's own uncertainty."""
        if self.alignment is None:
            return plume_map
        return georeference_map(plume_map, self.alignment, self.georeference)

    def describe(self) -> str:
        """What is known, in a few words."""
        if self.alignment is None:
            return "no known position; scale and up as reconstructed"
        known = [name for name in ("metric", "gravity", "located") if getattr(self.alignment, name)]
        sources = ", ".join(source.name for source in self.alignment.sources)
        return f"{', '.join(known)} by {sources}"

    def save(self, path: Path) -> None:
        """Writes JSON."""
        content = {
            "alignment": None if self.alignment is None else self.alignment.to_dict(),
            "georeference": None if self.georeference is None else self.georeference.to_dict(),
            "notes": list(self.notes),
        }
        path.write_text(json.dumps(content, indent=1))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote; a camera at rest has no such file and no placement.

        Raises:
            BadInputError: The file is damaged.
        """
        if not path.exists():
            return cls()
        content = read_json(path)
        try:
            alignment, georeference = content["alignment"], content["georeference"]
            return cls(
                alignment=None if alignment is None else Alignment.from_dict(alignment),
                georeference=None if georeference is None else Georeference.from_dict(georeference),
                notes=tuple(map(str, content["notes"])),
            )
        except (ValueError, KeyError, TypeError, BadInputError) as error:
            raise BadInputError(f"{path}: not a readable placement ({error})") from error
