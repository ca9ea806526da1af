"""The settings of a run."""

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from geometry.printable import printable

DetectorName = Literal["auto", "registered", "registered-plain", "bos", "dybs"]


class RunConfig(BaseModel):
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
        max_frames: The most frames that are used.
        max_side: Frames larger than this (px) are shrunk to it.
        detection_frames: In how many of them refraction is measured.
        seed: Of every random choice.

    Example:
        >>> import locate
        >>> config = locate.RunConfig(recording="video.mp4", focal_px=1450, max_frames=60)
        >>> config.detector
        'auto'
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    recording: Path
    detector: DetectorName = "auto"
    weights: Path | None = None
    poses: Path | None = None
    camera: Path | None = None
    focal_px: float | None = Field(default=None, gt=0)
    telemetry: Path | None = None
    telemetry_offset_s: float | None = Field(default=None, allow_inf_nan=False)
    image_topic: str | None = None
    pose_topic: str | None = None
    world_frame: str | None = None
    camera_height_m: float | None = Field(default=None, gt=0)
    board: str | None = None
    distance: Path | None = None
    shot: int | None = Field(default=None, ge=1)
    max_frames: int = Field(default=120, ge=2)
    max_side: int = Field(default=1280, ge=64)
    detection_frames: int = Field(default=16, ge=1)
    seed: int = 0

    def to_plain(self) -> dict[str, Any]:
        """The settings as JSON and YAML know them."""
        plain: dict[str, Any] = self.model_dump(mode="json")
        return {
            name: printable(value) if isinstance(value, str) else value
            for name, value in plain.items()
        }
