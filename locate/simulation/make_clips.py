"""Writes clips of real material for the learned registered detector.

    python -m locate.simulation.make_clips photos --photos DIR --seeds 200000 200060 -o CLIPS
    python -m locate.simulation.make_clips sets   --set PHOTOS --seeds 210000 210008 -o CLIPS

`photos` films scenes made of single photos, `sets` takes a set of real photos with known poses, as
they are or with plumes rendered onto them. Clips that are there are kept; lessons.jsonl lists what
each is.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import cv2

from detect.learning.clips import Leaks, TrainingClip, clip_path
from detect.synthesis.raster import find_photos
from geometry.errors import LocateError, UnwritableError
from geometry.regular_files import append_regular
from locate.simulation.clips import draw_clip_scene, make_photo_clip
from locate.simulation.nuisances import draw_nuisances
from locate.simulation.photo_set import PhotoSet
from locate.simulation.photo_set_clips import make_photo_set_clip

CLIPS_PER_FLOW = 4
"""Neighbouring seeds that share a flow, which costs most."""


def write_photo_clips(
    photos: Sequence[Path],
    seeds: Sequence[int],
    folder: Path,
    *,
    leaks: Leaks = "nozzle",
    plume: bool | None = None,
    nuisances: Sequence[str] | None = None,
    rough: bool = False,
    coded: bool = False,
) -> None:
    """Writes the clips of those seeds that are missing.

    Args:
        photos: To draw from; of one split.
        seeds: One per clip.
        folder: Made where it is missing.
        leaks: Where plumes leave.
        plume: Whether there is one; None leaves that to the seeds.
        nuisances: Their names; None draws a few for each clip.
        rough: Whether they are filmed as `degrade_capture` does it, with its own nuisances.
        coded: Whether they are stored as videos of few bits.
    """
    for seed in seeds:
        if clip_path(folder, seed).exists():
            continue
        drawn = () if rough else draw_nuisances(draw_clip_scene(seed).random_stream(25))
        names = drawn if nuisances is None else nuisances
        clip = make_photo_clip(
            seed, photos, leaks=leaks, plume=plume, nuisances=names, rough=rough, coded=coded
        )
        about = {"leaks": leaks, "nuisances": list(names), "rough": rough, "coded": coded}
        save_clip(clip, folder, seed, {"kind": "photos", **about})


def write_photo_set_clips(photo_set: Path, seeds: Sequence[int], folder: Path) -> None:
    """Writes the clips of those seeds that are missing, of one set of posed photos.

    Args:
        photo_set: What `PhotoSet.load` reads.
        seeds: One per clip; `CLIPS_PER_FLOW` after each other share a flow.
        folder: Made where it is missing.
    """
    photos = PhotoSet.load(photo_set)
    for seed in seeds:
        if not clip_path(folder, seed).exists():
            clip = make_photo_set_clip(photos, seed, flow_seed=seed // CLIPS_PER_FLOW)
            save_clip(clip, folder, seed, {"kind": "set", "set": photo_set.name})


def save_clip(clip: TrainingClip, folder: Path, seed: int, about: dict[str, object]) -> None:
    """Writes a training clip, and a line about it."""
    folder.mkdir(parents=True, exist_ok=True)
    clip.save(clip_path(folder, seed))
    line = {"seed": seed, "amplitude_px": clip.amplitude_px, "frames": len(clip), **about}
    path = folder / "lessons.jsonl"
    try:
        with append_regular(path) as journal:
            journal.write(json.dumps(line) + "\n")
    except OSError as error:
        raise UnwritableError.of(path, error) from error


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    kinds = parser.add_subparsers(dest="kind", required=True)
    photos = kinds.add_parser("photos")
    photos.add_argument("--photos", type=Path, required=True, help="folder of single photos")
    photos.add_argument("--split", choices=("train", "validation", "test"), default="train")
    photos.add_argument("--leaks", choices=("nozzle", "anywhere"), default="nozzle")
    photos.add_argument("--nuisances", nargs="*", default=None, help="instead of a random few")
    photos.add_argument("--rough", action="store_true", help="filmed carelessly")
    photos.add_argument("--coded", action="store_true", help="stored as videos of few bits")
    photos.add_argument("--plume", choices=("yes", "no"), default=None)
    sets = kinds.add_parser("sets")
    sets.add_argument("--set", type=Path, required=True, help="folder of photos with their poses")
    for kind in (photos, sets):
        kind.add_argument("--seeds", type=int, nargs=2, required=True, metavar=("FIRST", "END"))
        kind.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    try:
        _write_clips(arguments)
    except LocateError as error:
        parser.exit(error.exit_code, f"error: {error}\n")


def _write_clips(arguments: argparse.Namespace) -> None:
    seeds = range(*arguments.seeds)
    if arguments.kind == "sets":
        write_photo_set_clips(arguments.set, seeds, arguments.output)
        return
    write_photo_clips(
        find_photos(arguments.photos, arguments.split),
        seeds,
        arguments.output,
        leaks=arguments.leaks,
        plume=None if arguments.plume is None else arguments.plume == "yes",
        nuisances=arguments.nuisances,
        rough=arguments.rough,
        coded=arguments.coded,
    )


if __name__ == "__main__":
    main()
