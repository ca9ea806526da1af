"""Photos of several lenses, zooms or sizes in one folder: a run has one camera."""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from locate.recording.decoders import photo_size
from locate.recording.focal import (
    FOCAL_35MM,
    FOCAL_MM,
    exif_tags,
    exif_texts,
    focal_of_photo,
    read_header,
)

SAME_FOCAL = 0.01
"""Relative difference of focal lengths up to which photos are of one zoom."""
ORIENTATION, DIGITAL_ZOOM = 0x0112, 0xA404
MODEL, LENS = 0x0110, 0xA434
"""Tags of EXIF that tell cameras and lenses apart."""
TURNED = (5, 6, 7, 8)
"""Values of the orientation that swap the sides."""
QUARTER_TURNS = {1: 0, 3: 2, 6: 1, 8: 3}
"""By how many quarter turns clockwise a photo is shown, by its orientation; others mirror it."""
JPEG_START, JPEG_SIZES = b"\xff\xd8", {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""How a JPEG file begins, and which of its segments state the size (ITU T.81, table B.1)."""
NAMED_GROUPS = 4
"""Most groups that the note describes."""


@dataclass(frozen=True, kw_only=True)
class PhotoOptics:
    """What a photo says of the camera that took it.

    Attributes:
        size: Width and height as shown, px; None where the photo cannot be read.
        names: Of the camera and of the lens, empty where not stated.
        focals: Focal length over the longest side, in mm, in mm of 35 mm film, and the digital
            zoom; 0 where not stated.
        turn: By how many quarter turns clockwise it is shown; None where that is not stated.
    """

    size: tuple[int, int] | None
    names: tuple[str, str]
    focals: tuple[float, float, float, float]
    turn: int | None = None

    def is_like(self, other: "PhotoOptics") -> bool:
        """Whether one camera model may stand for both, portrait and landscape."""
        near = np.isclose(self.focals, other.focals, rtol=SAME_FOCAL, atol=0)
        return self.shape == other.shape and self.names == other.names and bool(near.all())

    @property
    def shape(self) -> list[int]:
        """Its shorter and its longer side, px; empty where the photo cannot be read."""
        return sorted(self.size or ())

    @property
    def states_focal(self) -> bool:
        """Whether it says anything of its focal length."""
        return any(self.focals[:3])

    def describe(self) -> str:
        """Its size and focal length, for people."""
        _, mm, mm_35, _ = self.focals
        width, height = self.size or (0, 0)
        focal = f"{mm_35:.4g} mm (35 mm film)" if mm_35 else f"{mm:.4g} mm" if mm else ""
        parts = (f"{width}x{height}", focal or "no focal length stated", *self.names)
        return " ".join(part for part in parts if part)


def optics_of_photo(path: Path) -> PhotoOptics:
    """Reads the header of a photo, and all of it where that does not state its size."""
    try:
        header = read_header(path)
        tags, texts, prior = exif_tags(header), exif_texts(header), focal_of_photo(path)
        size = _jpeg_size(header, turned=tags.get(ORIENTATION) in TURNED) or photo_size(path)
    except OSError:
        return PhotoOptics(size=None, names=("", ""), focals=(0, 0, 0, 0))
    stated = [0.0 if prior is None else prior.relative]
    stated += [tags.get(tag, 0.0) for tag in (FOCAL_MM, FOCAL_35MM)]
    zoom = tags.get(DIGITAL_ZOOM, 0.0) or 1.0  # 0 says that none was used
    return PhotoOptics(
        size=size,
        names=(texts.get(MODEL, ""), texts.get(LENS, "")),
        focals=(stated[0], stated[1], stated[2], zoom),
        turn=QUARTER_TURNS.get(int(tags.get(ORIENTATION, 0))),
    )


@dataclass(frozen=True, kw_only=True)
class OneCamera:
    """The photos of a folder that one camera model may stand for.

    Attributes:
        rows: Theirs among all.
        turns: Row of each that is portrait where most are landscape, or the reverse, with the
            quarter turns counterclockwise that make it like them.
        notes: What a reader must know of these and of the photos that are left out.
    """

    rows: tuple[int, ...]
    turns: Mapping[int, int]
    notes: tuple[str, ...]


def keep_one_camera(photos: Sequence[Path]) -> OneCamera:
    """The largest group of photos that one camera model may stand for.

    Photos that state no focal length, where others of their size state several, come last. Those
    that cannot be read stay, so that reading them says what is wrong.

    Args:
        photos: All that were given, in order.
    """
    every = [optics_of_photo(photo) for photo in photos]
    groups: list[list[int]] = []
    for row, optics in enumerate(every):
        if optics.size is None:
            continue
        group = next((each for each in groups if every[each[0]].is_like(optics)), None)
        if group is None:
            groups.append([row])
        else:
            group.append(row)
    if not groups:
        return OneCamera(rows=tuple(range(len(photos))), turns={}, notes=())
    firsts = [every[group[0]] for group in groups]
    groups.sort(
        key=lambda group: (not _may_be_mixed(every[group[0]], firsts), len(group)), reverse=True
    )
    unreadable = [row for row, optics in enumerate(every) if optics.size is None]
    notes = [_describe_groups(photos, every, groups)] if len(groups) > 1 else []
    turns = _turns_of(groups[0], every)
    if turns:
        notes.append(
            f"{len(turns)} of {len(groups[0])} photos are turned by 90 degrees, so that portrait "
            f"and landscape are of one camera ({photos[min(turns)].name} ...)."
        )
    return OneCamera(rows=tuple(sorted(groups[0] + unreadable)), turns=turns, notes=tuple(notes))


def _may_be_mixed(optics: PhotoOptics, groups: Sequence[PhotoOptics]) -> bool:
    """Whether photos that state no focal length may be of any of several that others state."""
    stated = [one for one in groups if one.states_focal and one.shape == optics.shape]
    return not optics.states_focal and len(stated) > 1


def _turns_of(group: list[int], every: list[PhotoOptics]) -> dict[int, int]:
    """Quarter turns counterclockwise of the photos that are not as wide as most of the group.

    By their stated orientations they become as the sensor saw the others; one that states none is
    turned either way, which another camera in the same place would explain as well.
    """
    sizes = [every[row].size for row in group]
    usual = max(sizes, key=sizes.count)
    turned_as = [every[row].turn for row in group if every[row].size == usual]
    reference = max(turned_as, key=turned_as.count)
    turns = {}
    for row in group:
        optics = every[row]
        if optics.size != usual:
            apart = 1 if optics.turn is None or reference is None else optics.turn - reference
            turns[row] = apart % 4 if apart % 2 else 1
    return turns


def _describe_groups(
    photos: Sequence[Path], every: list[PhotoOptics], groups: list[list[int]]
) -> str:
    others = sum(len(group) for group in groups[1:])
    listed = "; ".join(
        f"{len(group)} of {every[group[0]].describe()} ({photos[group[0]].name} ...)"
        for group in groups[:NAMED_GROUPS]
    )
    more = len(groups) - NAMED_GROUPS
    return (
        f"The photos are of {len(groups)} cameras, lenses, zooms or sizes: {listed}"
        + (f"; and {more} more groups" if more > 0 else "")
        + f". A run has one camera: the first group is used and {others} of {len(photos)} photos "
        "are left out; run each other group from a folder of its own."
    )


def _jpeg_size(header: bytes, *, turned: bool) -> tuple[int, int] | None:
    """Width and height as shown; None where the header holds no size of a JPEG."""
    at = len(JPEG_START)
    if header[:at] != JPEG_START:
        return None
    while at + 9 <= len(header) and header[at] == 0xFF:
        marker, length = header[at + 1], struct.unpack_from(">H", header, at + 2)[0]
        if marker in JPEG_SIZES:
            height, width = struct.unpack_from(">HH", header, at + 5)
            return (height, width) if turned else (width, height)
        at += 2 + length
    return None
