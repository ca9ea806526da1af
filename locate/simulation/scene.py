"""What a simulated recording is made of, as SCENE.yaml describes it."""

import math
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal, Self

import numpy as np
import yaml
from pydantic import ConfigDict, Field, ValidationError, model_validator

from geometry.camera import Camera
from geometry.errors import BadInputError, first_complaint
from geometry.plain_settings import PlainSettings
from geometry.refraction import MOLAR_MASS_KG
from geometry.text_files import read_yaml
from locate.simulation.materials import MATERIALS

Point = tuple[float, float, float]
PlanarPoint = tuple[float, float]
Positive = Annotated[float, Field(gt=0)]
SHORTEST_M = 1e-6
"""Length below which `start` and `end` are one place."""


class SceneBlock(PlainSettings):
    """One mapping of the file: immutable, every number finite, and a misspelt key an error."""

    model_config = ConfigDict(allow_inf_nan=False)


class SceneFile(SceneBlock):
    """A whole file."""

    @classmethod
    def load(cls, path: FilePath) -> Self:
        """Reads a YAML file.

        Raises:
            BadInputError: The file cannot be read, is not YAML, or a field is wrong; named.
        """
        content: Any = read_yaml(path)
        if not isinstance(content, dict):
            raise BadInputError(f"{path}: not a scene (expected a mapping with `objects`)")
        try:
            return cls.model_validate(content)
        except ValidationError as error:
            raise BadInputError(f"{path}: {first_complaint(error, 'field')}") from error

    def save(self, path: FilePath) -> None:
        """Writes a YAML file that `load` reads back."""
        content = self.model_dump(mode="json", exclude_defaults=True)
        path.write_text(yaml.safe_dump(content, sort_keys=False))


class CameraBlock(SceneBlock):
    """A pinhole camera, with one radial term where `radial` is not 0."""

    width: Annotated[int, Field(ge=32, le=8192)] = 640
    height: Annotated[int, Field(ge=32, le=8192)] = 480
    focal_px: Positive = 560.0
    radial: Annotated[float, Field(gt=-0.3, lt=0.3)] = 0.0

    def build(self) -> Camera:
        """The camera, principal point in the image centre."""
        pinhole = Camera.pinhole(self.width, self.height, self.focal_px)
        if not self.radial:
            return pinhole
        params = (self.focal_px, *pinhole.params[2:], self.radial)
        return Camera(model="SIMPLE_RADIAL", width=self.width, height=self.height, params=params)


class VideoBlock(SceneBlock):
    """Length and coding of the recording; `crf` counts for h264 alone."""

    frames: Annotated[int, Field(ge=1)] = 60
    fps: Annotated[float, Field(ge=0.1, le=1000)] = 15.0
    codec: Literal["ffv1", "h264"] = "ffv1"
    crf: Annotated[int, Field(ge=0, le=51)] = 18


class ImageBlock(SceneBlock):
    """Image formation: samples x samples rays a pixel, lens blur, exposure gain, sensor noise."""

    samples: Annotated[int, Field(ge=1, le=4)] = 2
    psf_sigma_px: Annotated[float, Field(ge=0)] = 0.5
    gain: Positive = 1.0
    noise: Annotated[float, Field(ge=0)] = 1.0


class PathBlock(SceneBlock):
    """How the camera moves.

    `orbit` and `handheld` go round `target` on an arc; `approach` and `hover` look at it from the
    bearing `start_deg` (counted from the x axis); `lawn_mower` flies `lanes` lanes of `length_m`
    above it, looking down by `pitch_deg`. `jitter_m` shakes every path smoothly (`jitter_deg` turns
    it), with the tempo of a hand.
    """

    kind: Literal["orbit", "handheld", "approach", "hover", "lawn_mower"] = "orbit"
    target: Point = (0.0, 0.0, 2.5)
    radius_m: Positive = 8.5
    height_m: float = 2.0
    start_deg: float = -120.0
    arc_deg: float = 60.0
    end_radius_m: Positive = 5.0
    lanes: Annotated[int, Field(ge=1)] = 3
    length_m: Positive = 8.0
    spacing_m: Positive = 1.5
    pitch_deg: Annotated[float, Field(ge=5, le=90)] = 55.0
    jitter_m: Annotated[float, Field(ge=0)] = 0.0
    jitter_deg: Annotated[float, Field(ge=0)] = 0.0


class TexturedObject(SceneBlock):
    """Anything with a surface."""

    material: str = "concrete"

    @model_validator(mode="after")
    def _known_material(self) -> Self:
        if self.material not in MATERIALS:
            raise ValueError(f"material {self.material!r} is not one of {', '.join(MATERIALS)}")
        return self


class StretchedObject(TexturedObject):
    """Anything that runs from `start` to `end`."""

    start: tuple[float, ...]
    end: tuple[float, ...]

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if math.dist(self.start, self.end) < SHORTEST_M:
            raise ValueError("start and end are one place")
        return self


class GroundObject(TexturedObject):
    """The square floor at z = 0, centred on the origin."""

    kind: Literal["ground"]
    extent_m: Positive = 60.0
    material: str = "gravel"


class WallObject(StretchedObject):
    """An upright wall over the line from `start` to `end`."""

    kind: Literal["wall"]
    start: PlanarPoint
    end: PlanarPoint
    height_m: Positive = 6.0
    thickness_m: Positive = 0.3
    material: str = "brick"


class BoxObject(TexturedObject):
    """A box, turned about the vertical."""

    kind: Literal["box"]
    center: Point
    size: Annotated[tuple[Positive, Positive, Positive], "x, y, z edges, m"]
    yaw_deg: float = 0.0


class CylinderObject(StretchedObject):
    """A round bar, pipe or drum with flat ends."""

    kind: Literal["cylinder"]
    start: Point
    end: Point
    radius_m: Positive = 0.1
    material: str = "paint"


class PipeRackObject(TexturedObject):
    """Columns, beams and `pipes` pipes on each level, along the x axis turned by `yaw_deg`."""

    kind: Literal["pipe_rack"]
    center: PlanarPoint = (0.0, 0.0)
    length_m: Positive = 8.0
    width_m: Positive = 1.4
    levels_m: Annotated[tuple[Positive, ...], Field(min_length=1)] = (1.6, 2.6)
    pipes: Annotated[int, Field(ge=1)] = 4
    yaw_deg: float = 0.0
    material: str = "paint"


class TankObject(TexturedObject):
    """An upright storage tank with a lid, a ladder and a guard rail."""

    kind: Literal["tank"]
    center: PlanarPoint
    radius_m: Positive = 1.5
    height_m: Positive = 4.0
    material: str = "plate"


SceneObject = Annotated[
    GroundObject | WallObject | BoxObject | CylinderObject | PipeRackObject | TankObject,
    Field(discriminator="kind"),
]


class PlumeSpec(SceneBlock):
    """A plume that leaves an upright exit of `radius_m` at `source`.

    Its strength is either `amplitude_px` (95th percentile of |w| over the plume's image footprint,
    mean over frames; the refractivity is scaled to reach it) or, where that is null, what
    `temperature_k`, `gas` and `mole_fraction` at the exit give. These drive the flow either way.
    Its turbulence follows from `flow_seed`, or, where that is null, from the seed of the scene.
    """

    kind: Literal["buoyant", "gaussian"] = "buoyant"
    source: Point
    radius_m: Positive = 0.12
    height_m: Positive = 3.2
    gas: str = "air"
    mole_fraction: Annotated[float, Field(gt=0, le=1)] = 1.0
    temperature_k: Positive = 438.0
    amplitude_px: Annotated[float, Field(ge=0)] | None = None
    exit_mps: Annotated[float, Field(ge=0)] = 0.4
    voxel_m: Positive | None = None
    flow_seed: Annotated[int, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _known_gas(self) -> Self:
        if self.gas not in MOLAR_MASS_KG:
            raise ValueError(f"gas {self.gas!r} is not one of {', '.join(MOLAR_MASS_KG)}")
        return self


class Scene(SceneFile):
    """A simulated recording: everything that `simulate` needs, and its seed."""

    seed: Annotated[int, Field(ge=0)] = 0
    camera: CameraBlock = CameraBlock()
    video: VideoBlock = VideoBlock()
    image: ImageBlock = ImageBlock()
    path: PathBlock = PathBlock()
    sky: bool = True
    sun_deg: PlanarPoint = (-60.0, 48.0)
    wind_mps: PlanarPoint = (0.0, 0.0)
    objects: tuple[SceneObject, ...] = ()
    plumes: tuple[PlumeSpec, ...] = ()

    @model_validator(mode="after")
    def _size_fits_codec(self) -> Self:
        odd = self.camera.width % 2 or self.camera.height % 2
        if self.video.codec == "h264" and odd:
            raise ValueError("video.codec h264 needs an even camera.width and camera.height")
        return self

    def random_stream(self, *stream: int) -> np.random.Generator:
        """The random numbers of one part of the recording, the same for every run."""
        return np.random.default_rng([self.seed, *stream])
