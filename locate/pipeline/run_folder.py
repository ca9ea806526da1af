"""A run is a folder: stages write files, all at once, and are skipped where these are valid."""

import logging
import sqlite3
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from geometry.atomic import is_unfinished, remove_unfinished, sync, sync_tree, write_text_atomic
from geometry.errors import BadInputError, describe_error
from geometry.lock import LOCK, hold_lock
from geometry.removal import path_inside, remove_inside
from geometry.text_files import read_yaml
from locate import __version__
from locate.journal.costs import StageTime, cpu_seconds
from locate.pipeline.config import SCHEMA
from locate.pipeline.files import RunFiles
from locate.pipeline.stage import Stage
from locate.pipeline.stamp import OWN_FILES, PUBLISHING, Stamp, digest_outputs

PARTIAL, STAMPS = ".partial", ".stages"
"""Where stages build their files, and where it is remembered that they are done."""
HIDDEN = (PARTIAL, STAMPS)
STAGE_LOCK = ".stage.lock"
"""Held while a stage is made, by one of the processes that hold the folder together."""
SYSTEM_ERRORS = (OSError, MemoryError, sqlite3.OperationalError)
"""What a disk, its rights or too little memory raise; the last is of GeoPackages."""
log = logging.getLogger("locate")


class RunFolder:
    """The folder of one run.

    A stage builds its files in ``.partial/``, they are moved into place when all of them are
    there, and a stamp in ``.stages/`` is written last: a run killed at any moment continues
    with the stage it was in, and a stage whose inputs and files have not changed is skipped.

    Args:
        root: The folder; made where it is missing.
        force: Do every stage again.

    Raises:
        BadInputError: The folder cannot be written, holds something else, or was written by
            another version of this program.
    """

    def __init__(self, root: Path, *, force: bool = False) -> None:
        self.root = root
        self.files = RunFiles(root)
        self.times: list[StageTime] = []
        self._force = force
        self._fingerprints: dict[str, str] = {}
        self._done: set[str] = set()
        try:
            root.mkdir(parents=True, exist_ok=True)
            for name in (*HIDDEN, *OWN_FILES, LOCK, STAGE_LOCK):
                path_inside(root, name)
            self._claim()
            for hidden in HIDDEN:
                (root / hidden).mkdir(exist_ok=True)
        except OSError as error:
            raise BadInputError(
                f"{root}: cannot be written ({error.strerror}); choose another folder with -o"
            ) from error

    @contextmanager
    def hold(self, *, shared: bool = False) -> Iterator[None]:
        """Keeps other commands from this folder while the block runs.

        Args:
            shared: Others may do a share of a stage at the same time, see `begin`.

        Raises:
            BadInputError: Another command is at work on it, or it cannot be written.
        """
        with self._report_errors("opening the folder"), hold_lock(self.root, shared=shared):
            if not shared:
                remove_unfinished(self.root)
            yield

    def _claim(self) -> None:
        """Refuses a folder that holds anything but what runs of this version leave."""
        for path in (self.files.config, self.files.log):
            if path.exists() and not path.is_file():
                raise BadInputError(f"{path}: not a file; choose another folder with -o")
        schema = self._read_schema()
        if schema is None and not self._holds_only_results():
            raise BadInputError(
                f"{self.files.config}: not a readable run configuration; "
                "choose another folder with -o"
                if self.files.config.exists()
                else f"{self.root}: not empty and not a run folder; choose another folder with -o"
            )
        if schema not in (None, SCHEMA):
            raise BadInputError(
                f"{self.root}: written as {schema}, this program reads {SCHEMA}; "
                "choose another folder with -o"
            )

    def _read_schema(self) -> object:
        """Of config.yaml; None where that is missing or damaged."""
        try:
            content = read_yaml(self.files.config)
        except BadInputError:
            return None
        return content.get("schema") if isinstance(content, dict) else None

    def _holds_only_results(self) -> bool:
        """Whether every file is named by a stamp or comes before any stage, but for config.yaml."""
        stamps = [Stamp.load(path) for path in (self.root / STAMPS).glob("[!.]*.json")]
        results = {name for stamp in stamps if stamp is not None for name in stamp.outputs}
        usual = {*HIDDEN, LOCK, STAGE_LOCK, self.files.log.name, *results}
        if results:
            usual.add(self.files.config.name)
        return all(path.name in usual or is_unfinished(path) for path in self.root.iterdir())

    def save_config(self, settings: Mapping[str, Any]) -> None:
        """Writes config.yaml."""
        content = {"schema": SCHEMA, "version": __version__, **settings}
        write_text_atomic(self.files.config, yaml.safe_dump(content, sort_keys=False))

    def complete(self, stage: Stage, build: Callable[[Path], str]) -> None:
        """Does a stage, or skips it where its result is valid.

        Args:
            stage: What it depends on.
            build: Writes the stage's files into the folder it is given, which may hold what an
                interrupted run of the same stage left there, and returns a note on the result.
        """
        fingerprint = self._fingerprint(stage)
        self._done.add(stage.name)
        # Of several processes that do shares of a later stage, one does this stage.
        with self._report_errors(stage.name), hold_lock(self.root, STAGE_LOCK, wait=True):
            stamp = self._valid_stamp(stage.name, fingerprint)
            if stamp is None:
                stamp = self._make(stage.name, fingerprint, build)
            else:
                log.info("skipped, its result is valid", extra={"stage": stage.name})
        self.times.append(stamp.time)

    def _make(self, name: str, fingerprint: str, build: Callable[[Path], str]) -> Stamp:
        self._withdraw(self._stamp_path(name))
        log.info("start", extra={"stage": name})
        wall, cpu = time.perf_counter(), cpu_seconds()
        partial = self._partial(name, fingerprint)
        note = build(partial)
        spent = StageTime(
            name=name,
            wall_s=time.perf_counter() - wall,
            cpu_s=cpu_seconds() - cpu,
            note=note,
        )
        stamp = self._publish(partial, fingerprint, spent)
        log.info(note, extra={"stage": name, "wall_s": spent.wall_s, "cpu_s": spent.cpu_s})
        return stamp

    def begin(self, stage: Stage, build: Callable[[Path], str]) -> None:
        """Does a share of a stage, as several processes may at once; `complete` ends it.

        Args:
            stage: What it depends on.
            build: Writes some of the stage's files into the folder it is given.
        """
        fingerprint = self._fingerprint(stage)
        with self._report_errors(stage.name):
            if self._valid_stamp(stage.name, fingerprint) is None:
                build(self._partial(stage.name, fingerprint))

    def is_done(self, stage: Stage) -> bool:
        """Whether a stage was done as it would be now; its files are not looked at."""
        stamp = None if self._force else Stamp.load(self._stamp_path(stage.name))
        return stamp is not None and stamp.fingerprint == self._fingerprint(stage)

    def was_done(self, name: str) -> bool:
        """Whether a stage was done once, with these inputs or others."""
        return not self._force and Stamp.load(self._stamp_path(name)) is not None

    def _fingerprint(self, stage: Stage) -> str:
        fingerprint = stage.fingerprint(self._fingerprints)
        self._fingerprints[stage.name] = fingerprint
        return fingerprint

    @contextmanager
    def _report_errors(self, doing: str) -> Iterator[None]:
        """Turns an error of the system, such as a full disk, into one line."""
        try:
            yield
        except SYSTEM_ERRORS as error:
            kept = ", ".join(one.name for one in self.times) or "no stage yet"
            raise BadInputError(
                f"{self.root}: {doing} failed, {describe_error(error)}; kept: {kept}; "
                "mend this, and the same command goes on from there"
            ) from error

    def _stamp_path(self, name: str) -> Path:
        return self.root / STAMPS / f"{name}.json"

    def _valid_stamp(self, name: str, fingerprint: str) -> Stamp | None:
        stamp = None if self._force else Stamp.load(self._stamp_path(name))
        if stamp is None or stamp.fingerprint != fingerprint:
            return None
        damaged = stamp.find_damage(self.root)
        if damaged is None:
            return stamp
        log.warning("%s is missing or was altered; done again", damaged, extra={"stage": name})
        return None

    def _withdraw(self, stamp_path: Path) -> None:
        """Removes what an earlier run of a stage left, so that no stale file outlives it.

        The stamp goes last: whoever is killed on the way, or the next one, knows what is left.
        """
        stamp = Stamp.load(stamp_path)
        for name in [] if stamp is None else stamp.outputs:
            remove_inside(self.root, name)
        remove_inside(stamp_path.parent, stamp_path.name)

    def withdraw_others(self) -> None:
        """Removes what earlier runs left that this one has not: results of stages, half stages."""
        self.remove_results(
            {path.stem for path in (self.root / STAMPS).glob("[!.]*.json")} - self._done
        )

    def remove_results(self, stages: Collection[str]) -> None:
        """Removes the results of some stages, which the next run makes again, and half stages."""
        with self._report_errors("removing old results"):
            for name in stages:
                self._withdraw(self._stamp_path(name))
            for left in self.half_stages():
                remove_inside(left.parent, left.name)

    def results_of(self, stage: str) -> list[Path]:
        """What is there of the files and folders that a stage left."""
        stamp = Stamp.load(self._stamp_path(stage))
        outputs = [] if stamp is None else [self.root / name for name in stamp.outputs]
        return [path for path in outputs if path.exists()]

    def half_stages(self) -> list[Path]:
        """What interrupted stages left."""
        return sorted((self.root / PARTIAL).iterdir())

    def _partial(self, name: str, fingerprint: str) -> Path:
        """Where the stage builds; what the same stage left there with the same inputs is kept."""
        mine = self.root / PARTIAL / f"{name}-{fingerprint[:12]}"
        for other in (self.root / PARTIAL).glob(f"{name}-*"):
            linked = any(path.is_symlink() for path in (other, *other.rglob("*")))
            if other != mine or self._force or linked:
                remove_inside(other.parent, other.name)
        mine.mkdir(exist_ok=True)
        return mine

    def _publish(self, partial: Path, fingerprint: str, spent: StageTime) -> Stamp:
        """Moves the files of a stage into place; a kill on the way leaves none without a stamp."""
        stamp = Stamp(
            fingerprint=fingerprint,
            outputs=sorted(path.name for path in partial.iterdir()),
            files=digest_outputs(partial),
            time=spent,
        )
        path = self._stamp_path(spent.name)
        sync_tree(partial)
        stamp.model_copy(update={"fingerprint": PUBLISHING}).save(path)
        for name in stamp.outputs:
            remove_inside(self.root, name)
            (partial / name).replace(self.root / name)
        partial.rmdir()
        sync(self.root)
        stamp.save(path)
        return stamp
