"""A run is a folder: stages write files, all at once, and are skipped where these are valid."""

import json
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import yaml

from geometry.atomic import write_text_atomic
from geometry.errors import BadInputError
from geometry.removal import path_inside, remove_inside
from locate import __version__
from locate.journal.costs import StageTime, cpu_seconds
from locate.pipeline.files import RunFiles
from locate.pipeline.fingerprint import digest, fingerprint_code
from locate.pipeline.stamp import OWN_FILES, Stamp

SCHEMA = "locate.run/1"
PARTIAL, STAMPS = ".partial", ".stages"
"""Where stages build their files, and where it is remembered that they are done."""
HIDDEN = (PARTIAL, STAMPS)
log = logging.getLogger("locate")


class RunFolder:
    """The folder of one run.

    A stage builds its files in ``.partial/``, they are moved into place when all of them are
    there, and a stamp in ``.stages/`` is written last: a run killed at any moment continues
    with the stage it was in, and a stage whose inputs have not changed is skipped.

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
            self._claim()
            for name in (*HIDDEN, *OWN_FILES):
                path_inside(root, name)
            for hidden in HIDDEN:
                (root / hidden).mkdir(exist_ok=True)
        except OSError as error:
            raise BadInputError(
                f"{root}: cannot be written ({error.strerror}); choose another folder with -o"
            ) from error

    def _claim(self) -> None:
        if self.files.config.is_file():
            self._check_version()
        elif any(path.name not in (*HIDDEN, self.files.log.name) for path in self.root.iterdir()):
            raise BadInputError(
                f"{self.root}: not empty and not a run folder; choose another folder with -o"
            )

    def _check_version(self) -> None:
        path = self.files.config
        try:
            content = yaml.safe_load(path.read_text())
            schema = content["schema"]
        except (OSError, ValueError, yaml.YAMLError, KeyError, TypeError) as error:
            raise BadInputError(f"{path}: not a readable run configuration") from error
        if schema != SCHEMA:
            raise BadInputError(
                f"{self.root}: written as {schema}, this program reads {SCHEMA}; "
                "choose another folder with -o"
            )

    def save_config(self, settings: Mapping[str, Any]) -> None:
        """Writes config.yaml."""
        content = {"schema": SCHEMA, "version": __version__, **settings}
        write_text_atomic(self.files.config, yaml.safe_dump(content, sort_keys=False))

    def stage(
        self,
        name: str,
        *,
        after: tuple[str, ...] = (),
        inputs: Mapping[str, object],
        code: Sequence[ModuleType] = (),
        build: Callable[[Path], str],
    ) -> None:
        """Does one stage, or skips it where its result is valid.

        Args:
            name: Of the stage.
            after: The stages whose results it reads.
            inputs: What else its result depends on; JSON-able.
            code: The modules that make the result; with all that they import of this program,
                they are part of what it depends on.
            build: Writes the stage's files into the folder it is given, which may hold what an
                interrupted run of the same stage left there, and returns a note on the result.
        """
        fingerprint = self._fingerprint(name, after, inputs, code)
        self._done.add(name)
        stamp_path = self.root / STAMPS / f"{name}.json"
        stamp = self._valid_stamp(stamp_path, fingerprint)
        if stamp is not None:
            self.times.append(stamp.time)
            log.info("skipped, its result is valid", extra={"stage": name})
            return
        self._withdraw(stamp_path)
        log.info("start", extra={"stage": name})
        wall, cpu = time.perf_counter(), cpu_seconds()
        partial = self._partial(name, fingerprint)
        note = build(partial)
        outputs = self._publish(partial)
        spent = StageTime(
            name=name,
            wall_s=time.perf_counter() - wall,
            cpu_s=cpu_seconds() - cpu,
            note=note,
        )
        self.times.append(spent)
        Stamp(fingerprint=fingerprint, outputs=outputs, time=spent).save(stamp_path)
        log.info(note, extra={"stage": name, "wall_s": spent.wall_s, "cpu_s": spent.cpu_s})

    def begin(
        self,
        name: str,
        *,
        after: tuple[str, ...] = (),
        inputs: Mapping[str, object],
        code: Sequence[ModuleType] = (),
        build: Callable[[Path], str],
    ) -> None:
        """Does a share of a stage, as several processes may at once; `stage` finishes it.

        Args:
            name: As of `stage`.
            after: Likewise.
            inputs: Likewise.
            code: Likewise.
            build: Writes some of the stage's files into the folder it is given.
        """
        fingerprint = self._fingerprint(name, after, inputs, code)
        if self._valid_stamp(self.root / STAMPS / f"{name}.json", fingerprint) is None:
            build(self._partial(name, fingerprint))

    def _fingerprint(
        self,
        name: str,
        after: tuple[str, ...],
        inputs: Mapping[str, object],
        code: Sequence[ModuleType],
    ) -> str:
        depends: dict[str, object] = {
            "stage": name,
            "version": __version__,
            "inputs": dict(inputs),
            "code": [fingerprint_code(module.__name__) for module in code],
        }
        depends["after"] = [self._fingerprints[other] for other in after]
        fingerprint = digest(json.dumps(depends, sort_keys=True).encode())
        self._fingerprints[name] = fingerprint
        return fingerprint

    def _valid_stamp(self, stamp_path: Path, fingerprint: str) -> Stamp | None:
        stamp = None if self._force else Stamp.load(stamp_path)
        if stamp is None or stamp.fingerprint != fingerprint:
            return None
        return stamp if all((self.root / name).exists() for name in stamp.outputs) else None

    def _withdraw(self, stamp_path: Path) -> None:
        """Removes what an earlier run of a stage left, so that no stale file outlives it."""
        stamp = Stamp.load(stamp_path)
        remove_inside(stamp_path.parent, stamp_path.name)
        for name in [] if stamp is None else stamp.outputs:
            remove_inside(self.root, name)

    def withdraw_others(self) -> None:
        """Removes the results of stages that an earlier run had and this one has not."""
        for stamp_path in (self.root / STAMPS).glob("[!.]*.json"):
            if stamp_path.stem not in self._done:
                self._withdraw(stamp_path)

    def _partial(self, name: str, fingerprint: str) -> Path:
        """Where the stage builds; what the same stage left there with the same inputs is kept."""
        mine = self.root / PARTIAL / f"{name}-{fingerprint[:12]}"
        for other in (self.root / PARTIAL).glob(f"{name}-*"):
            linked = any(path.is_symlink() for path in (other, *other.rglob("*")))
            if other != mine or self._force or linked:
                remove_inside(other.parent, other.name)
        mine.mkdir(exist_ok=True)
        return mine

    def _publish(self, partial: Path) -> list[str]:
        names = sorted(path.name for path in partial.iterdir())
        for name in names:
            remove_inside(self.root, name)
            (partial / name).replace(self.root / name)
        partial.rmdir()
        return names
