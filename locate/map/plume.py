"""The answer: plumes in 3D, or bearings where the camera stood still, and their file map.json."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import numpy as np

from detect.haze import Haze
from geometry.arrays import FloatArray
from geometry.covariance import principal_sigmas
from geometry.errors import BadInputError
from geometry.plain import to_plain_values
from geometry.text_files import read_json
from locate.map.answer import Answer, Obstacle
from locate.map.schema import SCHEMA, RefractiveIndex, checked_fields


@dataclass(frozen=True, kw_only=True)
class Plume:
    """A column of refracting air.

    Attributes:
        id: Number within the map, from 1, strongest evidence first.
        source: (3,) where it leaves the ground or the leak, in world units.
        source_covariance: (3, 3) of `source`, world axes, world units squared.
        axis: (3,) unit vector of the rise, in the world.
        axis_sigma_rad: Standard deviation of the direction of `axis`, rad.
        extent_low: Distance along the axis from the source where evidence begins; above 0, the
            lowest part itself was not seen and the source is an extrapolation.
        extent_high: Distance along the axis where evidence ends.
        radius_by_height: (M, 2) of [distance along the axis from the source, radius].
        evidence_nats: Summed log-likelihood ratio of this plume against none, in independent
            samples: neighbouring pixels with the same noise count once.
        probability: 1 minus the probability that the same volume without plumes, seen by as many
            views without common evidence, holds a column with that much evidence.
        views: Indices of the frames that saw it.
        displacement_px: Mean displacement it causes in those frames.
        source_hidden: Something hides the source in the frames that would show it.
        refractive_index: Of what it is made of, against the air around it: ``"lower"`` where it
            bends light away from its axis (hot air, hydrogen, helium), ``"higher"`` where towards
            it (cold air, methane, propane, carbon dioxide); None where the views do not agree.

    Examples:
        >>> import locate
        >>> for plume in locate.load_map("out").plumes:
        ...     assert plume.source.shape == (3,)
        ...     assert plume.source_covariance.shape == (3, 3)
    """

    id: int
    source: FloatArray
    source_covariance: FloatArray
    axis: FloatArray
    axis_sigma_rad: float
    extent_low: float
    extent_high: float
    radius_by_height: FloatArray
    evidence_nats: float
    probability: float
    views: tuple[int, ...]
    displacement_px: float
    source_hidden: bool = False
    refractive_index: RefractiveIndex | None = None

    _SHAPES: ClassVar = {"source": (3,), "source_covariance": (3, 3), "axis": (3,)}

    def __post_init__(self) -> None:
        for name, expected in self._SHAPES.items():
            if (got := getattr(self, name).shape) != expected:
                raise ValueError(f"{name}.shape={got}, expected {expected}")
        if self.radius_by_height.ndim != 2 or self.radius_by_height.shape[1] != 2:
            raise ValueError(f"{self.radius_by_height.shape=}, expected (M, 2)")

    @property
    def principal_sigmas(self) -> FloatArray:
        """(3,) 1-sigma of the source along its principal axes, largest first, in world units."""
        return principal_sigmas(self.source_covariance)

    def points_on_axis(self, distances: FloatArray) -> FloatArray:
        """(K, 3) world points at (K,) distances along the axis from the source."""
        return np.asarray(self.source + distances[:, None] * self.axis)


@dataclass(frozen=True, kw_only=True)
class Bearing:
    """A plume seen from one viewpoint: a direction, no position.

    Attributes:
        direction_in_cam: (3,) unit vector towards the plume's base; x right, y down, z forward.
        sigma_rad: Standard deviation of the direction, rad.
        evidence_nats: As of a `Plume`.
        probability: Likewise, for the frame in place of the volume: against chance, not against
            what moves by itself, such as leaves.
        displacement_px: Mean displacement it causes.

    Examples:
        >>> import locate
        >>> for bearing in locate.load_map("out").bearings:
        ...     right, down, forward = bearing.direction_in_cam
    """

    direction_in_cam: FloatArray
    sigma_rad: float
    evidence_nats: float
    probability: float
    displacement_px: float


@dataclass(frozen=True, kw_only=True)
class PlumeMap:
    """What a run found, and what it would have found.

    Attributes:
        units: ``"m"``, or ``"scene"`` where the scale is free.
        gravity: World Z is known to point up; otherwise the direction of up is a guess.
        georeference: Where the local east-north-up world sits on the Earth (WGS84):
            ``origin_lat_deg, origin_lon_deg, origin_height_m, height_datum``; None where unknown.
        plumes: The plumes, strongest evidence first.
        bearings: Directions to plumes, from a camera that stood still.
        haze: Moving air all over the image of such a camera; None where there is none.
        detection_limit_px: Mean displacement of the weakest plume that would have been found in
            half of the places observed; None where none would, or it was not computed.
        detection_limit_k: The same as a temperature difference, K; only in a metric map.
        obstacles: What kept the run from judging, where it could judge nothing.
        notes: What a reader must know, one sentence each.
        detector: Name of the detector.
        version: Version of this program.

    Examples:
        >>> import locate
        >>> plume_map = locate.load_map("out")
        >>> plume_map.save("copy.json")
        >>> locate.load_map("copy.json").to_dict() == plume_map.to_dict()
        True
    """

    units: Literal["m", "scene"]
    gravity: bool
    detector: str
    version: str
    georeference: dict[str, Any] | None = None
    plumes: tuple[Plume, ...] = ()
    bearings: tuple[Bearing, ...] = ()
    haze: Haze | None = None
    detection_limit_px: float | None = None
    detection_limit_k: float | None = None
    obstacles: tuple[Obstacle, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def unit_name(self) -> str:
        """The unit as printed behind a number."""
        return "m" if self.units == "m" else "scene units"

    @property
    def answer(self) -> Answer:
        """Whether there are plumes, none, or nothing could be judged."""
        if self.plumes or self.bearings:
            return Answer.FOUND
        judged = self.detection_limit_px is not None
        return Answer.NONE_FOUND if judged else Answer.NOT_JUDGED

    def limit_text(self) -> str:
        """What was found, and the weakest plume that would have been; or why none would."""
        if self.bearings:
            count = len(self.bearings)
            return "One direction found." if count == 1 else f"{count} directions found."
        if self.answer is Answer.NOT_JUDGED:
            why = self.obstacles[0].why if self.obstacles else "Why is not known."
            return f"Nothing could be judged. {why} {self.haze_text()}".rstrip()
        if self.haze is not None:
            return f"{self.haze_text()} {self._weakest_text('A plume')}"
        found = {0: "None found", 1: "One found"}.get(len(self.plumes), f"{len(self.plumes)} found")
        weakest = self._weakest_text("a plume")
        return f"{found}; {weakest or 'the weakest plume that would have been seen is not known.'}"

    def obstacles_text(self) -> str:
        """Why nothing could be judged, all of it; empty where something was."""
        return " ".join(obstacle.why for obstacle in self.obstacles)

    def _weakest_text(self, subject: str) -> str:
        """Which plume would have been seen; empty where that is not known."""
        if self.detection_limit_px is None:
            return ""
        kelvin = self.detection_limit_k
        heat = "" if kelvin is None else f", about {kelvin:.2g} K warmer than the air,"
        size = f"{self.detection_limit_px:.2g} px"
        return f"{subject} of {size}{heat} would have been seen in half of the places."

    def haze_text(self) -> str:
        """How strong the haze is and where, as one sentence; empty where there is none."""
        if self.haze is None:
            return ""
        heights = [px for px in self.haze.by_height() if px is not None]
        size = f"{self.haze.rms_px:.2g} px rms"
        if len(heights) > 1:
            size += f", {heights[0]:.2g} px at the top and {heights[-1]:.2g} px at the bottom"
        return f"Haze: the air moves all over the image, {size}; no single plume stands out of it."

    def to_dict(self) -> dict[str, Any]:
        """The content of map.json, schema ``locate.map/2``."""
        return {"schema": SCHEMA, "answer": str(self.answer), **to_plain_values(asdict(self))}

    @classmethod
    def from_dict(cls, content: Any) -> Self:
        """Reads the content of map.json, also as earlier versions wrote it.

        Raises:
            BadInputError: Another schema, a missing key, or a value of the wrong kind.
        """
        fields = checked_fields(content)
        plumes = tuple(Plume(**plume) for plume in fields.pop("plumes"))
        bearings = tuple(Bearing(**bearing) for bearing in fields.pop("bearings"))
        haze, obstacles = fields.pop("haze"), fields.pop("obstacles")
        return cls(
            **fields,
            plumes=plumes,
            bearings=bearings,
            haze=None if haze is None else Haze(**haze),
            obstacles=tuple(Obstacle(**obstacle) for obstacle in obstacles),
        )

    def save(self, path: str | Path) -> None:
        """Writes map.json.

        Raises:
            ValueError: A number is not finite.
        """
        Path(path).write_text(json.dumps(self.to_dict(), indent=1, allow_nan=False))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Reads map.json.

        Raises:
            BadInputError: The file is missing, not JSON, or not a map of this version.
        """
        content = read_json(Path(path))
        try:
            return cls.from_dict(content)
        except BadInputError as error:
            raise BadInputError(f"{path}: {error}") from error
