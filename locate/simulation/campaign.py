"""A survey campaign: flights over one site on several days, thermals that come and go."""

import datetime as dt
import json
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from geometry.arrays import FloatArray
from geometry.atomic import write_text_atomic
from geometry.errors import BadInputError
from geometry.georeference import Georeference, HeightDatum
from geometry.text_files import read_text
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.recording import Progress, ignore_progress, simulate
from locate.simulation.scene import (
    CameraBlock,
    ImageBlock,
    PathBlock,
    PlanarPoint,
    PlumeSpec,
    Point,
    Positive,
    Scene,
    SceneBlock,
    SceneFile,
    SceneObject,
    VideoBlock,
)
from locate.simulation.subtitles import GpsReceiver, write_subtitles

SCHEMA = "locate.campaign-truth/1"
Probability = Annotated[float, Field(ge=0, le=1)]
NotNegative = Annotated[float, Field(ge=0)]
CELLS_PER_RADIUS = 3
"""Voxels of a Gaussian column, along its radius."""
NOON_ELEVATION_DEG = 55.0
"""Of the sun, in a northern summer."""
LOWEST_SUN_DEG = 8.0
"""Elevation at which the sun stays when it would be lower: nights are not simulated."""
_STREAM = {"thermals": 20, "wind": 21, "receiver": 22}


class CampaignOrigin(SceneBlock):
    """Where the campaign's east-north-up frame sits; heights are ellipsoidal."""

    lat_deg: Annotated[float, Field(ge=-90, le=90)] = 47.0
    lon_deg: Annotated[float, Field(ge=-180, le=180)] = 8.0
    height_m: float = 500.0

    def build(self) -> Georeference:
        """The frame."""
        return Georeference(
            lat_deg=self.lat_deg,
            lon_deg=self.lon_deg,
            height_m=self.height_m,
            datum=HeightDatum.ELLIPSOID,
            name="campaign",
        )


class ThermalSite(SceneBlock):
    """A place where a column of warm air rises at times.

    It is there with the probability that `occurrence` gives for the local hour, linear between
    the hours named. Its foot is then `drift_s` seconds downwind of `position`, and `wander_m`
    (one sigma, each way) off by chance.
    """

    name: str
    position: Point
    kind: Literal["gaussian", "buoyant"] = "gaussian"
    radius_m: Positive = 1.2
    height_m: Positive = 20.0
    amplitude_px: NotNegative = 1.5
    occurrence: Annotated[dict[float, Probability], Field(min_length=1)]
    drift_s: NotNegative = 0.0
    wander_m: NotNegative = 0.0

    def probability_at(self, hour: float) -> float:
        """That the column is there at a local hour."""
        hours, chances = zip(*sorted(self.occurrence.items()), strict=True)
        return float(np.interp(hour, hours, chances))


class FlightPlan(SceneBlock):
    """One recording: when, and along what path; wind drawn where it is not given."""

    name: Annotated[str, Field(pattern=r"^\w[\w.-]*$")]
    start: dt.datetime
    path: PathBlock
    wind_mps: PlanarPoint | None = None

    @property
    def local_hour(self) -> float:
        """Local time of day."""
        midnight = self.start.replace(hour=0, minute=0, second=0, microsecond=0)
        return (self.start - midnight) / dt.timedelta(hours=1)


class Campaign(SceneFile):
    """Everything that `simulate_campaign` needs, and its seed; times are local."""

    kind: Literal["campaign"]
    seed: Annotated[int, Field(ge=0)] = 0
    origin: CampaignOrigin = CampaignOrigin()
    camera: CameraBlock = CameraBlock()
    video: VideoBlock = VideoBlock()
    image: ImageBlock = ImageBlock()
    receiver: GpsReceiver = GpsReceiver()
    wind_mps: PlanarPoint = (0.0, 0.0)
    wind_sigma_mps: NotNegative = 0.0
    objects: tuple[SceneObject, ...] = ()
    sites: tuple[ThermalSite, ...] = ()
    flights: Annotated[tuple[FlightPlan, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _names_differ(self) -> "Campaign":
        for kind, things in (("flight", self.flights), ("site", self.sites)):
            names = [thing.name for thing in things]
            if len(set(names)) < len(names):
                raise ValueError(f"two {kind}s have one name")
        return self

    def random_stream(self, part: str, number: int) -> np.random.Generator:
        """The random numbers of one part of one flight, whatever other flights there are."""
        return np.random.default_rng([self.seed, _STREAM[part], number])

    def wind_of(self, number: int) -> PlanarPoint:
        """Of a flight, m/s to the east and the north."""
        given = self.flights[number].wind_mps
        if given is not None:
            return given
        drawn = self.random_stream("wind", number).normal(self.wind_mps, self.wind_sigma_mps)
        return float(drawn[0]), float(drawn[1])

    def columns_of(self, number: int) -> dict[str, Point]:
        """Feet of the columns that stand during a flight, by the name of their site."""
        rng, hour = self.random_stream("thermals", number), self.flights[number].local_hour
        east, north = self.wind_of(number)
        feet: dict[str, Point] = {}
        for site in self.sites:
            chance, wander = rng.uniform(), rng.normal(size=2) * site.wander_m
            if chance < site.probability_at(hour):
                x, y, z = site.position
                x += float(wander[0]) + site.drift_s * east
                feet[site.name] = (x, y + float(wander[1]) + site.drift_s * north, z)
        return feet

    def scene_of(self, number: int) -> Scene:
        """What one flight records."""
        flight, feet = self.flights[number], self.columns_of(number)
        shared = ("kind", "radius_m", "height_m", "amplitude_px")
        plumes = tuple(
            PlumeSpec(
                source=feet[site.name],
                voxel_m=site.radius_m / CELLS_PER_RADIUS if site.kind == "gaussian" else None,
                **{name: getattr(site, name) for name in shared},
            )
            for site in self.sites
            if site.name in feet
        )
        return Scene(
            seed=self.seed,
            camera=self.camera,
            video=self.video,
            image=self.image,
            path=flight.path,
            sun_deg=sun_at(flight.local_hour),
            wind_mps=self.wind_of(number),
            objects=self.objects,
            plumes=plumes,
        )


def sun_at(hour: float) -> PlanarPoint:
    """Azimuth from the east, counter-clockwise, and elevation of a northern summer's sun, deg."""
    elevation = NOON_ELEVATION_DEG * np.sin(np.pi * (hour - 6) / 12)
    return -15 * (hour - 6), max(float(elevation), LOWEST_SUN_DEG)


def is_campaign(path: Path) -> bool:
    """Whether a scene file describes a campaign."""
    try:
        lines = read_text(path).splitlines()
    except BadInputError:
        return False
    return any(line.split("#")[0].strip() == "kind: campaign" for line in lines)


def simulate_campaign(
    campaign: Campaign, output: Path, *, progress: Progress = ignore_progress
) -> None:
    """Renders every flight; one whose video is there already is left as it is.

    Writes campaign.yaml, truth.json, camera.json (for ``--camera``), videos/NAME.mkv (or .mp4) with
    videos/NAME.srt, and for each flight truth/NAME as ``simulate`` does.

    Args:
        campaign: What to record.
        output: Folder to write, made where it does not stand.
        progress: Called with the number of frames done and their total.

    Raises:
        BadInputError: The folder cannot be written, or holds another campaign.
    """
    _claim_folder(campaign, output)
    place, frames = campaign.origin.build(), campaign.video.frames
    flights = []
    for number, flight in enumerate(campaign.flights):
        scene, folder = campaign.scene_of(number), output / "truth" / flight.name
        suffix = ".mkv" if campaign.video.codec == "ffv1" else ".mp4"
        video = output / "videos" / (flight.name + suffix)
        before = number * frames

        def report(done: int, _total: int, before: int = before) -> None:
            progress(before + done, frames * len(campaign.flights))

        if not video.exists():
            simulate(scene, folder, progress=report)
            write_subtitles(
                video.with_suffix(".srt"),
                simulate_trajectory(scene),
                place,
                campaign.receiver,
                start=flight.start,
                rng=campaign.random_stream("receiver", number),
            )
            (folder / f"video{suffix}").replace(video)
        flights.append(_flight_truth(campaign, number, video.relative_to(output)))
    content = {
        "schema": SCHEMA,
        "origin": place.to_dict(),
        "sites": [_site_truth(site, place) for site in campaign.sites],
        "flights": flights,
    }
    write_text_atomic(output / "truth.json", json.dumps(content, indent=1))


def _claim_folder(campaign: Campaign, output: Path) -> None:
    try:
        (output / "videos").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(f"{output}: cannot be made a folder ({error})") from error
    described = output / "campaign.yaml"
    if described.exists():
        there, flights = Campaign.load(described), {"flights": campaign.flights}
        known = {flight.name: flight for flight in there.flights}
        same = all(known.get(flight.name, flight) == flight for flight in campaign.flights)
        if not same or there.model_copy(update=flights) != campaign:
            raise BadInputError(f"{output}: holds another campaign; choose another folder with -o")
    campaign.save(described)
    camera = campaign.camera.build().to_dict()
    (output / "camera.json").write_text(json.dumps({"camera": camera}, indent=1))


def _site_truth(site: ThermalSite, place: Georeference) -> dict[str, Any]:
    return {
        "name": site.name,
        "position": list(site.position),
        "lat_lon_height": _on_earth(place, np.array(site.position)),
        "radius": site.radius_m,
        "height": site.height_m,
        "occurrence": sorted([hour, chance] for hour, chance in site.occurrence.items()),
    }


def _flight_truth(campaign: Campaign, number: int, video: Path) -> dict[str, Any]:
    flight, feet, place = (
        campaign.flights[number],
        campaign.columns_of(number),
        campaign.origin.build(),
    )
    return {
        "name": flight.name,
        "video": str(video),
        "telemetry": str(video.with_suffix(".srt")),
        "truth": f"truth/{flight.name}",
        "start_local": flight.start.isoformat(),
        "local_hour": flight.local_hour,
        "wind_mps": list(campaign.wind_of(number)),
        "columns": [
            {
                "site": site.name,
                "on": site.name in feet,
                "probability": site.probability_at(flight.local_hour),
                "source": list(feet[site.name]) if site.name in feet else None,
                "lat_lon_height": _on_earth(place, np.array(feet[site.name]))
                if site.name in feet
                else None,
            }
            for site in campaign.sites
        ],
    }


def _on_earth(place: Georeference, point: FloatArray) -> list[float]:
    return [float(value) for value in place.lat_lon_height(point)[0]]
