"""The settings of a run."""

from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, ValidationError

from geometry.errors import BadInputError, first_complaint
from geometry.plain_settings import PlainSettings
from geometry.printable import printable
from geometry.text_files import read_yaml
from locate.pipeline.effort import EFFORTS, Amounts, Effort

SCHEMA = "locate.run/1"
BESIDE = ("schema", "version")
"""What config.yaml holds besides settings."""
Lens = Literal["auto", "pinhole", "radial", "fisheye"]
DetectorName = Literal["auto", "registered", "registered-plain", "bos", "dybs"]


class RunConfig(PlainSettings):
    """The settings of a run, kept beside its results in config.yaml.

    Attributes:
        recording: A video file or a folder of photos.
        detector: How refraction is seen; ``auto`` looks at the motion, and lets ``dybs`` help.
        weights: An .onnx file for ``dybs`` instead of those installed; for the network over
            neighbours where the detector is ``registered``.
        poses: Known camera poses (TUM, COLMAP, transforms.json, trajectory.json); no structure
            from motion then.
        camera: A JSON file with a ``camera`` block as in trajectory.json.
        focal_px: Focal length in px of the recording's own size.
        lens: What is estimated of a lens that is not known: one radial term by default, nothing
            (``pinhole``), two radial terms, or those of a ``fisheye``.
        telemetry: A file that says where the camera was; the recording's own metadata and files
            of its name if left out.
        telemetry_offset_s: Its time minus the video's; estimated from the motion if left out.
        image_topic: Of a bag; needed where it has several.
        pose_topic: Of a bag: odometry or a pose; ``tf`` for TF, which is taken if it is there.
        world_frame: Of a bag's TF; ``map`` if left out.
        camera_height_m: Of the cameras above the ground, if known; it sets the scale.
        board: A printed board of markers in the scene; it sets the scale.
        distance: A JSON file with the distance of two points of the scene; it sets the scale.
        shot: Of a video with cuts, the shot to use, from 1; the longest if left out.
        effort: How much is looked at, where the next five do not say so.
        max_frames: The most frames that are used.
        max_side: Frames larger than this (px) are shrunk to it; poses, and the evidence of single
            pixels, are of frames of at most 1280 px.
        detection_frames: In how many of them refraction is measured.
        displacement_frames: Of how many others the displacement alone is measured where the answer
            is unsure, or always where the effort is thorough.
        neighbours: With how many others each frame is compared.
        overlay: Write overlay.mp4, the frames in a row with what was found; for recordings up to a
            minute if left out.
        seed: Of the random choices after structure from motion, whose own is fixed.

    Examples:
        >>> import locate
        >>> config = locate.RunConfig(recording="video.mp4", focal_px=1450, max_frames=60)
        >>> config.detector
        'auto'
    """

    recording: Path
    detector: DetectorName = "auto"
    weights: Path | None = None
    poses: Path | None = None
    camera: Path | None = None
    focal_px: float | None = Field(default=None, gt=0, le=1e7)
    lens: Lens = "auto"
    telemetry: Path | None = None
    telemetry_offset_s: float | None = Field(default=None, allow_inf_nan=False)
    image_topic: str | None = None
    pose_topic: str | None = None
    world_frame: str | None = None
    camera_height_m: float | None = Field(default=None, gt=0, le=1e6)
    board: str | None = None
    distance: Path | None = None
    shot: int | None = Field(default=None, ge=1)
    effort: Effort = "usual"
    max_frames: int | None = Field(default=None, ge=2)
    max_side: int | None = Field(default=None, ge=64)
    detection_frames: int | None = Field(default=None, ge=1)
    displacement_frames: int | None = Field(default=None, ge=0)
    neighbours: int | None = Field(default=None, ge=2)
    overlay: bool | None = None
    seed: int = Field(default=0, ge=0)

    @property
    def amounts(self) -> Amounts:
        """How much is looked at: as given, else as of the effort."""
        asked = {name: getattr(self, name) for name in Amounts.__dataclass_fields__}
        given = {name: value for name, value in asked.items() if value is not None}
        return replace(EFFORTS[self.effort], **given)

    @classmethod
    def of(cls, settings: Mapping[str, Any], *, where: str = "") -> Self:
        """The configuration with these settings.

        Args:
            settings: Attributes by name; those left out are as usual.
            where: Said before a complaint, as the file that the settings are from.

        Raises:
            BadInputError: A setting is unknown, missing or out of range; it is named.
        """
        for name in settings:
            if name not in cls.model_fields:
                near = get_close_matches(str(name), cls.model_fields, n=1)
                advice = (
                    f"did you mean {near[0]}" if near else "they are " + ", ".join(cls.model_fields)
                )
                raise BadInputError(f"{where}no setting is called {name}; {advice}")
        try:
            return cls.model_validate(dict(settings))
        except ValidationError as error:
            raise BadInputError(f"{where}{first_complaint(error, 'setting')}") from error

    def to_plain(self) -> dict[str, Any]:
        """The settings as JSON and YAML know them."""
        plain: dict[str, Any] = self.model_dump(mode="json")
        return {
            name: printable(value) if isinstance(value, str) else value
            for name, value in plain.items()
        }


def read_settings(path: Path) -> dict[str, Any]:
    """The settings that a file states, in the form of a run's config.yaml.

    They are checked but for being complete: the recording and any other may be left out.

    Raises:
        BadInputError: It cannot be read, or states what is no setting or out of range.
    """
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise BadInputError(f"{path}: no settings; write lines such as `max_frames: 60`")
    schema = content.get("schema", SCHEMA)
    if schema != SCHEMA:
        raise BadInputError(f"{path}: written as {schema}, this program reads {SCHEMA}")
    settings = {name: value for name, value in content.items() if name not in BESIDE}
    RunConfig.of({"recording": path, **settings}, where=f"{path}: ")
    return settings
