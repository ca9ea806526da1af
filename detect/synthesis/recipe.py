"""What a set of synthetic samples is made of."""

from pathlib import Path
from typing import Any, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from detect.synthesis.patterns import PatternRanges
from detect.synthesis.split import Split
from geometry.errors import BadInputError, first_complaint
from geometry.text_files import read_yaml

Family = Literal["sinusoid", "checkerboard", "lines", "perlin", "squares", "scene", "photo"]
FAMILIES: tuple[Family, ...] = get_args(Family)
SampleFamily = Literal[Family, "recorded"]
SAMPLE_FAMILIES: tuple[SampleFamily, ...] = get_args(SampleFamily)
"""What can be drawn, and what a camera recorded; the numbers in a shard count through these."""
Range = tuple[float, float]


class Recipe(BaseModel):
    """The mixture, and the ranges that everything is drawn from; ranges are least and most.

    Attributes:
        seed: Of every random choice.
        split: Which photos and runs may be used.
        size_px: Side of the square samples.
        families: Weight of each kind of background; they need not sum to 1.
        photos: Folder of photos, searched through its subfolders; needed for `photo`.
        flows: Folder of simulated runs; without one all plumes are random turbulence.
        turbulence_share: Share of plumes that are random turbulence in spite of `flows`.
        negatives: Share of samples without a plume.
        negatives_of: The same, for single families.
        peak_px: Largest displacement of a plume; drawn log-uniformly.
        plume_length: Longest side of a plume, in sides of the frame; log-uniform.
        visible_px: A displacement above this counts as plume in the mask.
        drift_px: How far a plume moves during the exposure.
        exposures: The most moments that are averaged over the exposure.
        noise: Standard deviation of the sensor noise, grey levels of 255; log-uniform.
        psf_sigma_px: Lens blur.
        gamma: Exponent of the tone curve.
        jpeg_share: Share of samples that went through JPEG.
        jpeg_quality: 1 to 100.
        period_px: Of sinusoids, checkerboards and lines; log-uniform.
        angle_deg: Of the same, across the lines.
        carriers: The most directions a sinusoid may have.
        tilt: How much nearer one side of a pattern's wall may be than the other.
        light_fall: How much the light may fall off over the frame.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    seed: int = Field(default=0, ge=0)
    split: Split = "train"
    size_px: int = Field(default=128, ge=32, le=1024)
    families: dict[Family, float]
    photos: Path | None = None
    flows: Path | None = None
    turbulence_share: float = Field(default=0.2, ge=0, le=1)
    negatives: float = Field(default=0.35, ge=0, le=1)
    negatives_of: dict[Family, float] = Field(default_factory=dict)
    peak_px: Range = (0.08, 1.1)
    plume_length: Range = (1.0, 4.0)
    visible_px: float = Field(default=0.05, gt=0)
    drift_px: Range = (0.0, 1.5)
    exposures: int = Field(default=3, ge=1, le=9)
    noise: Range = (0.3, 3.0)
    psf_sigma_px: Range = (0.35, 0.6)
    gamma: Range = (0.7, 1.4)
    jpeg_share: float = Field(default=0.2, ge=0, le=1)
    jpeg_quality: tuple[int, int] = (60, 98)
    period_px: Range = (4.0, 24.0)
    angle_deg: Range = (0.0, 180.0)
    carriers: int = Field(default=2, ge=1, le=2)
    tilt: float = Field(default=0.2, ge=0, le=0.5)
    light_fall: float = Field(default=0.3, ge=0, le=0.8)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        for name, value in self:
            if isinstance(value, tuple) and value[0] > value[1]:
                raise ValueError(f"{name}: {value[0]} is more than {value[1]}")
        for name in ("peak_px", "plume_length", "noise", "psf_sigma_px", "gamma", "jpeg_quality"):
            if getattr(self, name)[0] <= 0:
                raise ValueError(f"{name}: must be above 0")
        if self.period_px[0] < 2.5 or self.jpeg_quality[1] > 100 or self.drift_px[0] < 0:
            raise ValueError(
                "period_px starts at 2.5, jpeg_quality ends at 100, drift_px is from 0"
            )
        if self.peak_px[0] <= self.visible_px:
            raise ValueError("peak_px must start above visible_px, or plumes would have no mask")
        weights = list(self.families.values())
        if min(weights, default=0) < 0 or sum(weights) <= 0:
            raise ValueError("families: weights must be 0 or more, and one above 0")
        if any(not 0 <= share <= 1 for share in self.negatives_of.values()):
            raise ValueError("negatives_of: shares lie between 0 and 1")
        if self.families.get("photo", 0) > 0 and self.photos is None:
            raise ValueError("families: photo needs a folder, `photos: FOLDER`")
        return self

    @classmethod
    def from_plain(cls, content: object, where: str = "recipe") -> Self:
        """Checks settings as YAML and JSON know them.

        Raises:
            BadInputError: A setting is unknown, missing or out of range.
        """
        try:
            return cls.model_validate(content)
        except ValidationError as error:
            message = " ".join(part for part in first_complaint(error) if part)
            raise BadInputError(f"{where}: {message}") from error

    @classmethod
    def load(cls, path: Path, data: Path | None = None) -> Self:
        """Reads a YAML file.

        Args:
            path: The file.
            data: Where its folders are; where the file is if left out.

        Raises:
            BadInputError: It cannot be read, or is not a recipe.
        """
        content = read_yaml(path)
        if isinstance(content, dict):
            for name in ("photos", "flows"):
                if isinstance(content.get(name), str):
                    content[name] = str((data or path.parent) / content[name])
        return cls.from_plain(content, str(path))

    def to_plain(self) -> dict[str, Any]:
        """The settings as JSON and YAML know them."""
        plain: dict[str, Any] = self.model_dump(mode="json")
        return plain

    @property
    def lattice(self) -> PatternRanges:
        """How its regular patterns may look."""
        return PatternRanges(
            period_px=self.period_px, angle_deg=self.angle_deg, carriers=self.carriers
        )
