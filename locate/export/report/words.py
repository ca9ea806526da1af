"""The sentences of the report."""

from collections.abc import Iterator

import numpy as np

from geometry.trajectory import Trajectory
from locate.export.table import probability_text
from locate.map.answer import Answer
from locate.map.plume import PlumeMap

LIKE = {"lower": "hot air, hydrogen and helium", "higher": "cold air, methane and propane"}


def headline(plume_map: PlumeMap) -> str:
    """The answer in a few words."""
    if plume_map.answer is Answer.NOT_JUDGED:
        return "Nothing could be judged"
    found = len(plume_map.plumes)
    if plume_map.bearings:
        found, what = len(plume_map.bearings), "direction to a plume"
        return f"{found} {what}" if found == 1 else f"{found} directions to plumes"
    if plume_map.haze is not None:
        return "Haze all over the image"
    return ("No plume found", "One plume found")[found] if found < 2 else f"{found} plumes found"


def lead(plume_map: PlumeMap) -> str:
    """The answer in one sentence."""
    if plume_map.plumes:
        best = plume_map.plumes[0]
        sigma, unit = best.principal_sigmas[0], plume_map.unit_name
        decimals = max(0, -int(np.floor(np.log10(max(sigma, 1e-6)))))
        place = ", ".join(f"{value:.{decimals}f}" for value in best.source)
        subject = "It rises" if len(plume_map.plumes) == 1 else "The strongest rises"
        return (
            f"{subject} from {place} {unit}, give or take {sigma:.{decimals}f} {unit} (1 sigma in "
            f"the least certain direction), with probability {probability_text(best.probability)}."
        )
    if plume_map.bearings:
        return "The camera stood still: one viewpoint gives directions, not positions."
    if plume_map.answer is Answer.NOT_JUDGED:
        return f"That no plume was found means nothing here. {plume_map.obstacles_text()}"
    return plume_map.limit_text()


def facts(plume_map: PlumeMap, trajectory: Trajectory | None) -> Iterator[tuple[str, str]]:
    """Short facts for the head of the page."""
    if trajectory is not None:
        yield "Frames with a pose", f"{len(trajectory)}"
        arc = np.linalg.norm(np.diff(trajectory.centers_in_world, axis=0), axis=1).sum()
        yield "Camera path", f"{arc:.3g} {plume_map.unit_name}"
    limit = plume_map.detection_limit_px
    if limit is not None:
        yield "Seen in half of the places", f"a plume of {limit:.2g} px"
    elif not plume_map.bearings:
        yield "Seen in half of the places", "no plume of any strength"
    if plume_map.haze is not None:
        yield "Haze", f"{plume_map.haze.rms_px:.2g} px rms"
    yield "Detector", plume_map.detector
    if trajectory is not None:
        yield "Units", "metres" if plume_map.units == "m" else "scene units"


def limits(plume_map: PlumeMap, trajectory: Trajectory | None) -> Iterator[str]:
    """The limits of the result, one sentence each; the notes of the map included."""
    if plume_map.answer is not Answer.NOT_JUDGED:
        yield plume_map.limit_text()
    yield from plume_map.notes
    if plume_map.plumes or plume_map.bearings:
        yield (
            "The probability comes from an extreme-value fit to a dozen random draws of the run's "
            'own maps: "> 0.999" is an extrapolation.'
        )
    if trajectory is None:
        return
    if plume_map.georeference is None:
        yield "The map is not tied to the Earth: x, y, z are local."
    for plume in plume_map.plumes:
        if plume.source_hidden:
            yield f"The source of plume {plume.id} is hidden from the camera."
        if plume.refractive_index is not None:
            yield (
                f"Plume {plume.id} bends light as {LIKE[plume.refractive_index]} do: "
                "that does not identify the gas."
            )
        if plume.extent_low > 0:
            yield (
                f"Plume {plume.id} was seen from {plume.extent_low:.2f} {plume_map.unit_name} "
                "above its source upwards; below that its axis is extended, not observed."
            )
        if len(plume.views) == 1:
            yield f"Plume {plume.id} was seen by one frame only: its distance is weak."
    if plume_map.plumes:
        yield (
            "The covariance covers noise in the pictures and poses, as far as the model goes; "
            "it does not cover wind that bends the plume or a source that moves."
        )
