"""Fusion of flights alone, over many made-up campaigns: no video, no detector.

    python -m benchmarks.survey fusion --campaigns 200 --first 1000

Eight flights over 80 m by 80 m with six sites at least 8 m apart. A column stands at a site with a
probability of its own, 1 m (1 sigma) about it and 6 m downwind per unit of lean. A flight sees a
standing column with probability 0.8, 0.5 m off on each axis, and 0.2 columns that are not there;
its frame is off by 2 m east and north, 4 m up, 0.2 degrees and 0.2 %.
"""

import argparse
from dataclasses import dataclass

import numpy as np

from benchmarks.survey.sightings import offset_of, sighting
from geometry.arrays import BoolArray, FloatArray
from locate.evaluation.plumes import pair_within_gate
from locate.survey.associate import associate
from locate.survey.frame import FlightOffset, PlumeSighting
from locate.survey.occurrence import hotspot_posterior
from locate.survey.scoring import GATE_M

FLIGHTS, SITES, SIZE_M, APART_M = 8, 6, 80.0, 8.0
OWN_M, WANDER_M, DRIFT_M, LEAN = 0.5, 1.0, 6.0, 0.2
DETECTED, INVENTED = 0.8, 0.2
OFFSET_SIGMAS = np.array([0.0035, 0.0035, 0.0035, 2.0, 2.0, 4.0, 0.002])


@dataclass(frozen=True, kw_only=True)
class DrawnCampaign:
    """One campaign: sites, how likely each is, what stood, what was seen."""

    sites: FloatArray
    chance: FloatArray
    stood: BoolArray
    leans: FloatArray
    offsets: list[FlightOffset]
    seen: list[PlumeSighting]
    site_of: FloatArray


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--first", type=int, default=1000, help="seed of the first campaign")


def main(options: argparse.Namespace) -> None:
    campaigns, first = options.campaigns, options.first
    results = [scores(draw_campaign(np.random.default_rng(first + i))) for i in range(campaigns)]
    total = {key: np.concatenate([result[key] for result in results]) for key in results[0]}
    print(f"{campaigns} campaigns, {FLIGHTS} flights, {SITES} sites")
    print(f"sites where a column was seen  {total['found'].size}")
    print(f"  found within {GATE_M:g} m            {100 * total['found'].mean():.1f} %")
    print(f"  by one flight, mean          {100 * total['alone'].mean():.1f} %")
    print(f"false hotspots a campaign      {total['false'].mean():.2f}")
    print(f"  of them seen more than once  {total['false_twice'].mean():.2f}")
    print(f"invented sightings a campaign  {total['invented'].mean():.2f}")
    print(f"error of a hotspot, median     {np.median(total['error']):.2f} m")
    print(f"error of a sighting, median    {np.median(total['single']):.2f} m")
    print(f"NEES/dof, mean and median      {total['nees'].mean() / 2:.2f}, "
          f"{np.median(total['nees']) / 1.386:.2f}")  # fmt: skip
    print(f"drift, error over sigma, rms   {np.sqrt((total['drift'] ** 2).mean()):.2f}")
    print(f"occurrence said minus true     {total['said'].mean():+.3f}")
    print(f"  90 % intervals that hold it  {100 * total['inside'].mean():.1f} %")


def draw_campaign(rng: np.random.Generator) -> DrawnCampaign:
    sites = np.zeros((0, 3))
    while len(sites) < SITES:
        site = np.append(rng.uniform(-SIZE_M / 2, SIZE_M / 2, 2), 0.0)
        if not len(sites) or np.linalg.norm(sites - site, axis=1).min() > APART_M:
            sites = np.vstack([sites, site])
    chance = rng.uniform(0.2, 0.9, SITES)
    stood = rng.uniform(size=(FLIGHTS, SITES)) < chance
    leans = rng.normal(0, LEAN, (FLIGHTS, 2))
    leans -= leans.mean(axis=0)
    offsets, seen = [], []
    site_of: list[int] = []
    for flight in range(FLIGHTS):
        offsets.append(offset_of(flight, OFFSET_SIGMAS))
        off = OFFSET_SIGMAS * rng.normal(size=7)
        for k in np.flatnonzero(stood[flight] & (rng.uniform(size=SITES) < DETECTED)):
            foot = sites[k].copy()
            foot[:2] += rng.normal(0, WANDER_M, 2) + DRIFT_M * leans[flight]
            seen.append(sighting(flight, foot, off, OWN_M, rng))
            site_of.append(int(k))
        for _ in range(rng.poisson(INVENTED)):
            place = np.append(rng.uniform(-SIZE_M / 2, SIZE_M / 2, 2), 0.0)
            seen.append(sighting(flight, place, off, OWN_M, rng))
            site_of.append(-1)
    return DrawnCampaign(
        sites=sites, chance=chance, stood=stood, leans=leans, offsets=offsets, seen=seen,
        site_of=np.array(site_of),
    )  # fmt: skip


def scores(drawn: DrawnCampaign) -> dict[str, FloatArray]:
    fused = associate(drawn.seen, drawn.offsets, drawn.leans, wander_m=WANDER_M, area_m2=SIZE_M**2)
    solved, counts = fused.solution, np.bincount(fused.hotspot_of)
    visible = np.unique(drawn.site_of[drawn.site_of >= 0]).astype(int)
    apart = np.linalg.norm((drawn.sites[visible][:, None] - solved.positions)[..., :2], axis=-1)
    paired = [(int(visible[i]), k) for i, k in pair_within_gate(apart, np.array(GATE_M))]
    errors = [(solved.positions[k] - drawn.sites[i])[:2] for i, k in paired]
    answers = [hotspot_posterior(FLIGHTS, int(counts[k]), known_by_sight=True) for _, k in paired]
    chance = DETECTED * drawn.chance[[i for i, _ in paired]]
    false = [k for k in range(len(counts)) if k not in {k for _, k in paired}]
    single = [
        np.linalg.norm((one.position - drawn.sites[int(k)])[:2])
        for one, k in zip(drawn.seen, drawn.site_of, strict=True)
        if k >= 0
    ]
    return {
        "found": np.isin(visible, [i for i, _ in paired]).astype(float),
        "alone": np.array([(drawn.site_of >= 0).sum() / FLIGHTS / len(visible)]),
        "false": np.array([float(len(false))]),
        "false_twice": np.array([float((counts[false] > 1).sum())]),
        "invented": np.array([float((drawn.site_of < 0).sum())]),
        "error": np.linalg.norm(errors, axis=1),
        "single": np.array(single),
        "nees": np.array([
            error @ np.linalg.solve(solved.covariances[k][:2, :2], error)
            for error, (_, k) in zip(errors, paired, strict=True)
        ]),
        "drift": np.array([(solved.shared.drift_m - DRIFT_M) / solved.shared.drift_sigma_m]),
        "said": np.array([mean for mean, _, _ in answers]) - chance,
        "inside": np.array([
            float(low <= true <= high)
            for (_, low, high), true in zip(answers, chance, strict=True)
        ]),
    }  # fmt: skip
