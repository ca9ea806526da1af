"""A survey compared with the truth of a simulated campaign."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from rich.table import Table

from geometry.arrays import BoolArray, FloatArray
from geometry.errors import BadInputError
from geometry.georeference import Georeference
from geometry.json_values import as_numbers, as_truth
from geometry.text_files import read_json
from geometry.trajectory import FARTHEST
from locate.evaluation.plumes import pair_within_gate
from locate.simulation.campaign import SCHEMA, Campaign
from locate.survey.frame import offset_of
from locate.survey.model import Survey

MALFORMED = (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError)
"""What reading a file of another content raises."""
GATE_M = 5.0
"""Farthest that a hotspot may be from its site, in the horizontal; chosen."""


@dataclass(frozen=True, kw_only=True)
class CampaignTruth:
    """The truth of S sites and F flights of a campaign, in the frame of a survey.

    Attributes:
        names: Of the F flights.
        sites: (S, 3) feet of the columns in the mean wind of the flights, m.
        standing: (F, S) whether a column was present.
        feet: (F, S, 3) where; NaN where none was.
        chance: (F, S) how likely it was.
    """

    names: tuple[str, ...]
    sites: FloatArray
    standing: BoolArray
    feet: FloatArray
    chance: FloatArray

    @classmethod
    def load(cls, folder: Path, frame: Georeference) -> Self:
        """Reads truth.json and campaign.yaml of a folder that ``locate simulate`` wrote.

        Raises:
            BadInputError: One is missing or is not of a campaign.
        """
        path = folder / "truth.json"
        content = read_json(path)
        try:
            if content["schema"] != SCHEMA:
                raise ValueError(f"schema {content['schema']!r}, expected {SCHEMA!r}")
            return cls._from_content(content, Campaign.load(folder / "campaign.yaml"), frame)
        except MALFORMED as error:
            raise BadInputError(f"{path}: not the truth of a campaign ({error!r})") from error

    @classmethod
    def _from_content(
        cls, content: dict[str, Any], campaign: Campaign, frame: Georeference
    ) -> Self:
        own = Georeference.from_dict(content["origin"])
        flights = content["flights"]
        winds = as_numbers([flight["wind_mps"] for flight in flights], "wind_mps")
        if not (np.abs(winds) < FARTHEST).all():
            raise ValueError("wind_mps: not a wind")
        wind = np.append(np.mean(winds, axis=0), 0.0)
        sites = [np.array(site.position) + site.drift_s * wind for site in campaign.sites]
        columns = [flight["columns"] for flight in flights]
        nowhere = [np.nan] * 3
        places = [[nowhere if c["source"] is None else c["source"] for c in row] for row in columns]
        feet = as_numbers(places, "source")
        if (np.abs(feet) > FARTHEST).any():
            raise ValueError("source: too far away")

        def to_survey_frame(points: Any) -> FloatArray:
            flat = frame.to_enu(own.lat_lon_height(np.reshape(points, (-1, 3))))
            return flat.reshape(np.shape(points))

        standing = [[as_truth(column["on"], "on") for column in row] for row in columns]
        return cls(
            names=tuple(flight["name"] for flight in flights),
            sites=to_survey_frame(np.reshape(sites, (-1, 3))),
            standing=np.array(standing, dtype=bool),
            feet=to_survey_frame(feet),
            chance=as_numbers([[c["probability"] for c in row] for row in columns], "probability"),
        )


@dataclass(frozen=True, kw_only=True)
class SurveyScore:
    """How good a survey is.

    Attributes:
        sites: Sites at which a column was present at least once in a flight that is on the map.
        found: How many of them a hotspot is paired with, within `GATE_M`.
        false: Hotspots without a site.
        errors_m: Horizontal error of each hotspot that was found.
        nees: Of each in the horizontal; 2 is expected.
        single_errors_m: Horizontal error of each sighting to the foot it saw, the flight alone.
        single_nees: Of each in the horizontal, by its flight's own covariance; 2 is expected.
        single_found: Share of `sites` that one flight finds, the mean of all.
        false_sightings: Sightings of no column.
        standing: Pairs of flight and column present.
        looks: Those of them in which, by the survey, the flight covered a found hotspot.
        seen: Those of `looks` that were seen.
        chance: True mean probability of each site that was found.
        said: The survey's estimate of it.
        inside: How many of its 90 % intervals hold the truth.
    """

    sites: int
    found: int
    false: int
    errors_m: tuple[float, ...]
    nees: tuple[float, ...]
    single_errors_m: tuple[float, ...]
    single_nees: tuple[float, ...]
    single_found: float
    false_sightings: int
    standing: int
    looks: int
    seen: int
    chance: tuple[float, ...]
    said: tuple[float, ...]
    inside: int


def score_survey(survey: Survey, folder: Path) -> SurveyScore:
    """Compares a survey with the campaign whose videos it was made from.

    Args:
        survey: Its flights bear the names of the campaign's.
        folder: That ``locate simulate`` wrote.

    Raises:
        BadInputError: The folder holds no campaign, or none of its flights is in the survey.
    """
    truth = CampaignTruth.load(folder, survey.frame)
    mapped = {flight.name for flight in survey.mapped}
    rows = {name: row for row, name in enumerate(truth.names) if name in mapped}
    if not rows:
        raise BadInputError(f"{folder}: holds none of the flights of the survey")
    used = list(rows.values())
    occupied = np.flatnonzero(truth.standing[used].any(axis=0))
    spots = np.reshape([spot.position for spot in survey.hotspots], (-1, 3))
    paired = [(int(occupied[i]), k) for i, k in _pair_sites(truth.sites[occupied], spots)]
    errors = [(spots[k] - truth.sites[i])[:2] for i, k in paired]
    covariances = [np.array(survey.hotspots[k].covariance)[:2, :2] for _, k in paired]
    single = [_score_sightings(survey, name, truth.feet[row]) for name, row in rows.items()]
    looks, seen = _count_covering(survey, truth, rows, paired)
    chance = truth.chance[used].mean(axis=0)
    totals = [survey.hotspots[k].occurrence[0] for _, k in paired]
    return SurveyScore(
        sites=len(occupied),
        found=len(paired),
        false=len(spots) - len(paired),
        errors_m=tuple(float(np.linalg.norm(error)) for error in errors),
        nees=tuple(_horizontal_nees(*pair) for pair in zip(errors, covariances, strict=True)),
        single_errors_m=tuple(
            float(np.linalg.norm(error)) for right, _ in single for error, _ in right
        ),
        single_nees=tuple(_horizontal_nees(*one) for right, _ in single for one in right),
        single_found=float(np.mean([len(right) for right, _ in single])) / max(len(occupied), 1),
        false_sightings=sum(wrong for _, wrong in single),
        standing=int(truth.standing[used].sum()),
        looks=looks,
        seen=seen,
        chance=tuple(float(chance[i]) for i, _ in paired),
        said=tuple(total.probability for total in totals),
        inside=sum(
            bool(total.low <= chance[i] <= total.high)
            for (i, _), total in zip(paired, totals, strict=True)
        ),
    )


def _pair_sites(sites: FloatArray, spots: FloatArray) -> list[tuple[int, int]]:
    apart = np.linalg.norm((sites[:, None] - spots)[..., :2], axis=-1)
    return pair_within_gate(apart, np.array(GATE_M))


def _horizontal_nees(error: FloatArray, covariance: FloatArray) -> float:
    return float(error @ np.linalg.solve(covariance, error))


def _score_sightings(
    survey: Survey, name: str, feet: FloatArray
) -> tuple[list[tuple[FloatArray, FloatArray]], int]:
    """(2,) error and (2, 2) covariance of a flight's own sightings, and how many are of nothing."""
    flight = next(flight for flight in survey.mapped if flight.name == name)
    to_survey_frame = offset_of(flight, survey.frame).survey_from_flight
    plumes = flight.plume_map.plumes
    positions = to_survey_frame(np.reshape([plume.source for plume in plumes], (-1, 3)))
    standing = feet[np.isfinite(feet).all(axis=1)]
    paired = _pair_sites(standing, positions)
    right = [
        (
            (positions[k] - standing[i])[:2],
            to_survey_frame.transform_covariance(plumes[k].source_covariance)[:2, :2],
        )
        for i, k in paired
    ]
    return right, len(plumes) - len(paired)


def _count_covering(
    survey: Survey, truth: CampaignTruth, rows: dict[str, int], paired: list[tuple[int, int]]
) -> tuple[int, int]:
    """Flights that covered a hotspot while its column was present, and how many of them saw it."""
    saw = {(one.flight, one.hotspot) for one in survey.sightings}
    looks = [
        (name, survey.hotspots[k].id) in saw
        for i, k in paired
        for name in survey.hotspots[k].looked_by
        if name in rows and truth.standing[rows[name], i]
    ]
    return len(looks), sum(looks)


def score_table(score: SurveyScore) -> Table:
    """Description and value of everything that was compared."""
    table = Table(title="Against the truth of the campaign", title_justify="left")
    table.add_column("quantity")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for row in _score_rows(score):
        table.add_row(*row)
    return table


def _score_rows(score: SurveyScore) -> Iterator[tuple[str, str, str]]:
    yield "sites where a column was present", f"{score.sites}", ""
    yield "found", f"{score.found}", ""
    yield "found by one flight, mean", f"{100 * score.single_found:.0f}", "%"
    yield "false hotspots", f"{score.false}", ""
    yield "false sightings", f"{score.false_sightings}", ""
    if score.errors_m:
        yield "error of a hotspot, median", f"{np.median(score.errors_m):.2f}", "m"
        yield "error of a hotspot, largest", f"{max(score.errors_m):.2f}", "m"
        yield "NEES of a hotspot, mean, 2 expected", f"{np.mean(score.nees):.2f}", ""
        yield "occurrence estimated, mean", f"{np.mean(score.said):.2f}", ""
        yield "occurrence in truth, mean", f"{np.mean(score.chance):.2f}", ""
        yield "90 % intervals that hold it", f"{score.inside} of {score.found}", ""
    if score.single_errors_m:
        yield (
            "error of one flight's sighting, median",
            f"{np.median(score.single_errors_m):.2f}",
            "m",
        )
        yield "NEES of it, median, 1.39 expected", f"{np.median(score.single_nees):.2f}", ""
    yield "flights that covered a present column, seen", f"{score.seen} of {score.looks}", ""
    sighted = len(score.single_errors_m)
    yield "columns present, seen by their flight", f"{sighted} of {score.standing}", ""
