"""`locate train`."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import detect
from geometry.errors import KEPT, BadInputError, UnwritableError
from geometry.lock import hold_output
from geometry.reports import Report
from locate.commands.console import Output, err, out
from locate.journal.progress import progress_bars

if TYPE_CHECKING:
    from detect.learning.config import PoolConfig, TrainConfig
    from detect.synthesis.split import Split


def train(
    config: Annotated[
        Path,
        typer.Argument(help="registered, judge, lite-fast, lite, paper, or a config of your own."),
    ],
    output: Output,
    data: Annotated[
        Path | None,
        typer.Option(help="Where its folders of samples are; beside the config if left out."),
    ] = None,
    processes: Annotated[
        int, typer.Option(help="For rendering samples that are missing.", min=1, max=1024)
    ] = 1,
) -> None:
    """Train a network; the same command goes on where a killed one stood."""
    from detect.learning.config import TrainConfig

    path = config_path(config)
    loaded = TrainConfig.load(path, data)
    try:
        from detect.learning.export import export_training
        from detect.learning.plot import plot_training
        from detect.learning.render import check_samples, render_missing
        from detect.learning.trainer import TrainingRun
    except ModuleNotFoundError as error:
        raise BadInputError("torch is missing; pip install 'plume-locate[train]'") from error

    if data is not None and not data.is_dir():
        raise BadInputError(f"{data}: no such folder; make it if its samples are to be rendered")
    with _saying_what_is_kept(), hold_output(output), progress_bars(err) as report:
        training = TrainingRun.begin(loaded, output)
        check_samples(loaded, data or path.parent)
        check_clips(loaded)
        render_missing(loaded, data or path.parent, report=report, processes=processes)
        measure_missing(loaded, report=report)
        render_missing_clips(loaded, report=report, processes=processes)
        training.run(report)
        files = [*export_training(loaded, output), plot_training(output, output / "training.png")]
    for file in files:
        out.print(f"Wrote {file}", soft_wrap=True)


@contextmanager
def _saying_what_is_kept() -> Iterator[None]:
    try:
        yield
    except UnwritableError as error:
        raise UnwritableError(f"{error}; {KEPT}, the same command goes on from there") from error


def config_path(config: Path) -> Path:
    """The file, or the shipped config of that name.

    Raises:
        BadInputError: It is neither.
    """
    if config.suffix or config.exists():
        return config
    shipped = {
        path.stem.replace("_", "-"): path
        for path in Path(detect.__file__).parent.glob("*/training/*.yaml")
    }
    if config.name not in shipped:
        raise BadInputError(f"{config}: neither a file nor one of {', '.join(sorted(shipped))}")
    return shipped[config.name]


def measure_missing(config: "TrainConfig", *, report: Report) -> None:
    """Measures the waves and edges of rendered samples where it is not done; 10 ms a sample."""
    from detect.learning.measured_samples import measure_samples

    for name, pool in config.pools.items():
        if pool.measured is not None:
            for share in measure_samples(pool.measured, pool.folder, pool.samples):
                report(f"measured: {name}", share)


def check_clips(config: "TrainConfig") -> None:
    """Checks, before anything is rendered, what clips that are missing are made of.

    Raises:
        BadInputError: Photos or their poses are missing, or the network does not take clips.
    """
    from detect.learning.clips import clip_path
    from detect.registered.features import FEATURES
    from locate.simulation.photo_set import PhotoSet

    for name, pool in config.pools.items():
        paths = [clip_path(pool.folder, seed) for seed in pool.all_seeds()]
        if all(path.exists() for path in paths):
            continue
        if pool.photo_set is not None:
            PhotoSet.load(pool.photo_set)
        else:
            _photos_of(name, pool, config)
        if config.network.channels != len(FEATURES):
            raise BadInputError(
                f"network: channels is {config.network.channels}, clips have {len(FEATURES)}"
            )


def _photos_of(name: str, pool: "PoolConfig", config: "TrainConfig") -> tuple[Path, ...]:
    """The photos that the clips of a pool are made of; none where they are not of photos."""
    from detect.synthesis.raster import find_photos

    split: Split = "validation" if name == config.validation else "train"
    return () if pool.photos is None else find_photos(pool.photos, split)


def render_missing_clips(config: "TrainConfig", *, report: Report, processes: int = 1) -> None:
    """Renders the clips of a training that are not there yet; some 20 s of CPU each.

    Raises:
        BadInputError: There are no photos of the split where clips are made of photos.
    """
    from detect.learning.clips import clip_path

    for name, pool in config.pools.items():
        seeds = [seed for seed in pool.all_seeds() if not clip_path(pool.folder, seed).exists()]
        if not seeds:
            continue
        pool.folder.mkdir(parents=True, exist_ok=True)
        photos = _photos_of(name, pool, config)
        render = partial(_render_clip, pool, photos)
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as workers:
            for done, _ in enumerate(workers.map(render, seeds), 1):
                report(f"clips: {name}", done / len(seeds))


def _render_clip(pool: "PoolConfig", photos: Sequence[Path], seed: int) -> None:
    import cv2

    from detect.learning.clips import clip_path
    from locate.simulation.clips import make_clip
    from locate.simulation.make_clips import write_photo_clips, write_photo_set_clips

    cv2.setNumThreads(1)
    if pool.photo_set is not None:
        write_photo_set_clips(pool.photo_set, [seed], pool.folder)
    elif photos:
        write_photo_clips(
            photos, [seed], pool.folder, leaks=pool.leaks, rough=pool.rough, coded=pool.coded
        )
    else:
        make_clip(seed, pool.leaks, coded=pool.coded).save(clip_path(pool.folder, seed))
