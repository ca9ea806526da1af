"""What a set of synthetic samples is made of."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import ConfigDict, Field, ValidationError, model_validator

from detect.synthesis.patterns import PatternRanges
from detect.synthesis.split import Split
from geometry.errors import BadInputError, first_complaint
from geometry.plain_settings import PlainSettings
from geometry.text_files import read_yaml

Family = Literal["sinusoid", "checkerboard", "lines", "perlin", "squares", "scene", "photo"]
FAMILIES: tuple[Family, ...] = get_args(Family)
SampleFamily = Literal[Family, "recorded"]
SAMPLE_FAMILIES: tuple[SampleFamily, ...] = get_args(SampleFamily)
"""What can be drawn, and what a camera recorded; the numbers in a shard count through these."""
Pixels = Annotated[float, Field(gt=0, le=1000)]
Drift = Annotated[float, Field(ge=0, le=1000)]
Length = Annotated[float, Field(gt=0, le=16)]
GreyLevels = Annotated[float, Field(gt=0, le=255)]
Exponent = Annotated[float, Field(gt=0, le=10)]
Quality = Annotated[int, Field(ge=1, le=100)]
Period = Annotated[float, Field(ge=2.5, le=1e4)]
Degrees = Annotated[float, Field(ge=-360, le=360)]
Weight = Annotated[float, Field(ge=0, le=1e6)]
Share = Annotated[float, Field(ge=0, le=1)]


class Recipe(PlainSettings):
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

    model_config = ConfigDict(allow_inf_nan=False)

    seed: int = Field(default=0, ge=0)
    split: Split = "train"
    size_px: int = Field(default=128, ge=32, le=1024)
    families: dict[Family, Weight]
    photos: Path | None = None
    flows: Path | None = None
    turbulence_share: Share = 0.2
    negatives: Share = 0.35
    negatives_of: dict[Family, Share] = Field(default_factory=dict)
    peak_px: tuple[Pixels, Pixels] = (0.08, 1.1)
    plume_length: tuple[Length, Length] = (1.0, 4.0)
    visible_px: Pixels = 0.05
    drift_px: tuple[Drift, Drift] = (0.0, 1.5)
    exposures: int = Field(default=3, ge=1, le=9)
    noise: tuple[GreyLevels, GreyLevels] = (0.3, 3.0)
    psf_sigma_px: tuple[Pixels, Pixels] = (0.35, 0.6)
    gamma: tuple[Exponent, Exponent] = (0.7, 1.4)
    jpeg_share: Share = 0.2
    jpeg_quality: tuple[Quality, Quality] = (60, 98)
    period_px: tuple[Period, Period] = (4.0, 24.0)
    angle_deg: tuple[Degrees, Degrees] = (0.0, 180.0)
    carriers: int = Field(default=2, ge=1, le=2)
    tilt: float = Field(default=0.2, ge=0, le=0.5)
    light_fall: float = Field(default=0.3, ge=0, le=0.8)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        for name, value in self:
            if isinstance(value, tuple) and value[0] > value[1]:
                raise ValueError(f"{name}: {value[0]} is more than {value[1]}")
        if self.peak_px[0] <= self.visible_px:
            raise ValueError("peak_px must start above visible_px, or plumes would have no mask")
        if not any(self.families.values()):
            raise ValueError("families: one of the weights must be above 0")
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
            raise BadInputError(f"{where}: {first_complaint(error)}") from error

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
