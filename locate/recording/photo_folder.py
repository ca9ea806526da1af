"""The photos of a folder, apart from what else lies there."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from geometry.errors import BadInputError
from geometry.regular_files import open_regular
from locate.recording.decoders import missing_extra, photo_size
from locate.recording.formats import (
    PHOTO_SUFFIXES,
    READ,
    PhotoKind,
    kind_of_photo,
)
from locate.recording.tiff_pages import TiffPages

MUCH_SMALLER = 0.5
"""Of the bytes and of the longest side of the usual photo, below which one is a thumbnail."""
MIN_USUAL = 2
"""Photos that are not much smaller, so that one panorama makes no thumbnails of the others."""
NOT_INSTALLED = ", extra not installed"
"""After the kind of a photo that only an extra reads."""
HEAD_BYTES = 64 * 1024
"""Of a TIFF file, up to its first directory, by which a raw photo is recognised."""


def list_photos(folder: Path) -> tuple[tuple[Path, ...], list[str]]:
    """The photos of a folder in natural order, and a note that counts what else is in it.

    Raises:
        BadInputError: The folder cannot be read, or holds no photo.
    """
    try:
        entries = [entry for entry in folder.iterdir() if not entry.name.startswith(".")]
    except OSError as error:
        raise BadInputError(f"{folder}: cannot be read ({error.strerror})") from error
    kinds = {entry: _kind_of(entry) for entry in sorted(entries, key=natural_key)}
    photos = [entry for entry, kind in kinds.items() if kind == "photo"]
    for entry in _copies_among(photos):
        kinds[entry] = "other format of the same photo"
    photos = [entry for entry, kind in kinds.items() if kind == "photo"]
    for entry in _thumbnails_among(photos):
        kinds[entry] = "thumbnail"
    photos = [entry for entry, kind in kinds.items() if kind == "photo"]
    if not photos:
        for entry, kind in kinds.items():
            if kind.endswith(NOT_INSTALLED):
                photo = kind_of_photo(entry)
                raise BadInputError(f"{entry}: to read {photo.value}s, {missing_extra(photo)}")
        raise BadInputError(f"{folder}: no photos in this folder (expected {READ})")
    return tuple(photos), _count_skipped(folder, kinds)


def natural_key(path: Path) -> list[tuple[int, str]]:
    """Sorts ``img2`` before ``img10``."""
    parts = re.split(r"(\d+)", path.name.lower())
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def note_further_pages(photos: Sequence[Path]) -> list[str]:
    """A note on TIFF files of a folder that hold more than the one picture that is read of each."""
    several = [photo for photo in photos if is_stack(photo)]
    if not several:
        return []
    first = several[0]
    return [
        f"only the first page of {len(several)} TIFF files is read (of the "
        f"{len(TiffPages.of(first))} of {first.name}); give a file alone to read its pages as a "
        "video"
    ]


def is_stack(path: Path) -> bool:
    """Whether a file is a TIFF of several pages, and no raw photo."""
    if path.suffix[:4].lower() != ".tif" or len(TiffPages.of(path)) < 2:
        return False
    with open_regular(path) as file:
        return kind_of_photo(path, file.read(HEAD_BYTES)) is PhotoKind.PLAIN


def _kind_of(entry: Path) -> str:
    if entry.is_symlink() and not entry.exists():
        return "link to nothing"
    if entry.is_dir():
        return "folder"
    if entry.suffix.lower() not in PHOTO_SUFFIXES or not entry.is_file():
        return "file of another kind"
    kind = kind_of_photo(entry)
    if missing_extra(kind) is not None:
        return f"{kind.value}{NOT_INSTALLED}"
    return "photo" if entry.stat().st_size else "empty file"


def _copies_among(photos: Sequence[Path]) -> list[Path]:
    """Raw and HEIC photos, and others of a rarer format, beside one of the same name."""
    suffixes = Counter(photo.suffix.lower() for photo in photos)
    by_stem: dict[str, list[Path]] = {}
    for photo in photos:
        by_stem.setdefault(photo.stem, []).append(photo)

    def preference(photo: Path) -> tuple[bool, int]:
        return kind_of_photo(photo) is not PhotoKind.PLAIN, -suffixes[photo.suffix.lower()]

    return [copy for same in by_stem.values() for copy in sorted(same, key=preference)[1:]]


def _thumbnails_among(photos: Sequence[Path]) -> list[Path]:
    """Those with less than half of the side of the usual photo, which holds the median byte."""
    sizes = np.array([photo.stat().st_size for photo in photos])
    order = np.argsort(sizes, kind="stable")
    if not len(photos):
        return []
    usual = int(order[np.searchsorted(np.cumsum(sizes[order]), sizes.sum() / 2)])
    suspects = [
        p for p, size in zip(photos, sizes, strict=True) if size < MUCH_SMALLER * sizes[usual]
    ]
    if not suspects or len(photos) - len(suspects) < MIN_USUAL:
        return []
    side = _longest_side(photos[usual])
    return [photo for photo in suspects if 0 < _longest_side(photo) < MUCH_SMALLER * side]


def _longest_side(photo: Path) -> int:
    """To within 8 px, which is fast to decode; 0 where it is unreadable."""
    return max(photo_size(photo, reduced=True) or (0,))


def _count_skipped(folder: Path, kinds: dict[Path, str]) -> list[str]:
    skipped = [kind for kind in kinds.values() if kind != "photo"]
    if not skipped:
        return []
    first = {kind: entry.name for entry, kind in reversed(kinds.items())}
    counts = (f"{kind}: {skipped.count(kind)} ({first[kind]})" for kind in dict.fromkeys(skipped))
    return [f"{folder.name}: entries that are no photos were skipped; {', '.join(counts)}"]
