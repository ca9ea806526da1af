"""Opens videos, TIFF stacks and photos: their sizes, bit depth and metadata; no frames are kept."""

from pathlib import Path

from geometry.errors import BadInputError
from geometry.regular_files import refuse_streams
from locate.recording.depth import stretch_notes, stretch_of_photos, stretch_of_video
from locate.recording.focal import focal_of_photo, focal_of_video
from locate.recording.formats import PHOTO_SUFFIXES
from locate.recording.photo_folder import is_stack, list_photos, note_further_pages
from locate.recording.photo_groups import keep_one_camera
from locate.recording.recording import Recording, photo_images, turn_image
from locate.recording.sizes import FrameSizes, SizeLimits
from locate.recording.stack import TiffStack
from locate.recording.video import first_video_image, read_video_header

DEFAULT_MAX_SIDE = 1280
"""Longest side at which frames are processed, px."""
ANY_SIDE = 1 << 30
"""A longest side that reduces no image, px."""


def open_recording(
    path: Path,
    *,
    max_side: int = DEFAULT_MAX_SIDE,
    full_side: int | None = None,
    one_camera: bool = False,
) -> Recording:
    """Opens a video, a folder of photos or a photo.

    Args:
        path: A video file, or a photo (`PHOTO_SUFFIXES`), or a folder of photos. A TIFF file of
            several pages is a video.
        max_side: Longer images are reduced to this many px on the longest side.
        full_side: The same of what is kept at full size; None: `max_side`.
        one_camera: Of photos by several lenses, zooms or of several sizes, take the largest group;
            a warning says so.

    Raises:
        BadInputError: Nothing there that can be read, or fewer than one frame.
    """
    if not path.exists():
        raise BadInputError(f"{path}: no such file or folder")
    refuse_streams(path)
    limits = SizeLimits(working=max_side, full=full_side or max_side)
    if path.is_dir():
        photos, warnings = list_photos(path)
    elif path.is_file() and path.suffix.lower() in PHOTO_SUFFIXES:
        photos, warnings = (path,), []
    else:
        return _open_video(path, limits)
    if len(photos) == 1 and is_stack(photos[0]):
        return _open_stack(photos[0], limits, warnings)
    return _open_photos(path, photos, limits, warnings, one_camera=one_camera)


def _open_video(path: Path, limits: SizeLimits) -> Recording:
    first = first_video_image(path)
    metadata, expected_frames = read_video_header(path)
    stretch = stretch_of_video(path)
    return Recording(
        path=path,
        photos=(),
        sizes=FrameSizes.of_image(path, first, limits),
        focal=focal_of_video(metadata),
        expected_frames=expected_frames,
        stretch=stretch,
        warnings=stretch_notes(path, stretch),
    )


def _open_stack(path: Path, limits: SizeLimits, warnings: list[str]) -> Recording:
    stack = TiffStack(path)
    first = next(stack.read([])).load()
    return Recording(
        path=path,
        photos=(),
        sizes=FrameSizes.of_image(path, first, limits),
        focal=focal_of_photo(path),
        expected_frames=stack.count,
        stretch=stack.stretch,
        warnings=[*warnings, *stretch_notes(path, stack.stretch)],
        read=stack.read,
    )


def _open_photos(
    path: Path,
    photos: tuple[Path, ...],
    limits: SizeLimits,
    warnings: list[str],
    *,
    one_camera: bool,
) -> Recording:
    warnings = [*warnings, *note_further_pages(photos)]
    photo_indices: tuple[int, ...] = ()
    turns: dict[int, int] = {}
    if one_camera:
        kept = keep_one_camera(photos)
        photo_indices = kept.rows if len(kept.rows) < len(photos) else ()
        photos = tuple(photos[row] for row in kept.rows)
        turns = {kept.rows.index(row): turn for row, turn in kept.turns.items()}
        warnings += kept.notes
    first = turn_image(next(photo_images(photos[:1], [], None)).load(), turns.get(0, 0))
    stretch = stretch_of_photos(photos)
    return Recording(
        path=path,
        photos=photos,
        sizes=FrameSizes.of_image(path, first, limits),
        focal=focal_of_photo(photos[0]),
        expected_frames=len(photos),
        stretch=stretch,
        photo_indices=photo_indices,
        turns=turns,
        warnings=[*warnings, *stretch_notes(path, stretch)],
    )
