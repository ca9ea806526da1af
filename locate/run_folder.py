"""A run is a folder: stages that write files, each atomic, each skipped when it stands."""

import hashlib
import json
import logging
import os
import shutil
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from geometry.atomic import replacing
from geometry.errors import BadInputError
from locate import __version__
from locate.export.report import StageTime

SCHEMA = "locate.run/1"
CONFIG, LOG = "config.yaml", "log.jsonl"
HIDDEN = (".partial", ".stages")
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
        self.times: list[StageTime] = []
        self._force = force
        self._fingerprints: dict[str, str] = {}
        self._done: set[str] = set()
        try:
            root.mkdir(parents=True, exist_ok=True)
            self._claim()
            for hidden in HIDDEN:
                (root / hidden).mkdir(exist_ok=True)
        except OSError as error:
            raise BadInputError(
                f"{root}: cannot be written ({error.strerror}); choose another folder with -o"
            ) from error

    def _claim(self) -> None:
        if (self.root / CONFIG).is_file():
            self._check_version()
        elif any(path.name not in (*HIDDEN, LOG) for path in self.root.iterdir()):
            raise BadInputError(
                f"{self.root}: not empty and not a run folder; choose another folder with -o"
            )

    def _check_version(self) -> None:
        path = self.root / CONFIG
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
        replace_text(self.root / CONFIG, yaml.safe_dump(content, sort_keys=False))

    def stage(
        self,
        name: str,
        *,
        after: tuple[str, ...] = (),
        inputs: Mapping[str, object],
        build: Callable[[Path], str],
    ) -> None:
        """Does one stage, or skips it where its result stands.

        Args:
            name: Of the stage.
            after: The stages whose results it reads.
            inputs: What else its result depends on; JSON-able.
            build: Writes the stage's files into the folder it is given, which may hold what an
                interrupted run of the same stage left there, and returns a note on the result.
        """
        fingerprint = self._fingerprint(name, after, inputs)
        self._done.add(name)
        stamp_path = self.root / ".stages" / f"{name}.json"
        stamp = self._standing(stamp_path, fingerprint)
        if stamp is not None:
            self.times.append(StageTime(**stamp["time"]))
            log.info("skipped, its result stands", extra={"stage": name})
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
        content = {"fingerprint": fingerprint, "outputs": outputs, "time": vars(spent)}
        replace_text(stamp_path, json.dumps(content, indent=1))
        log.info(note, extra={"stage": name, "wall_s": spent.wall_s, "cpu_s": spent.cpu_s})

    def begin(
        self,
        name: str,
        *,
        after: tuple[str, ...] = (),
        inputs: Mapping[str, object],
        build: Callable[[Path], str],
    ) -> None:
        """Does a share of a stage, as several processes may at once; `stage` finishes it.

        Args:
            name: As of `stage`.
            after: Likewise.
            inputs: Likewise.
            build: Writes some of the stage's files into the folder it is given.
        """
        fingerprint = self._fingerprint(name, after, inputs)
        if self._standing(self.root / ".stages" / f"{name}.json", fingerprint) is None:
            build(self._partial(name, fingerprint))

    def _fingerprint(self, name: str, after: tuple[str, ...], inputs: Mapping[str, object]) -> str:
        depends = {"stage": name, "version": __version__, "inputs": dict(inputs)}
        depends["after"] = [self._fingerprints[other] for other in after]
        fingerprint = digest(json.dumps(depends, sort_keys=True).encode())
        self._fingerprints[name] = fingerprint
        return fingerprint

    def _standing(self, stamp_path: Path, fingerprint: str) -> dict[str, Any] | None:
        if self._force or not stamp_path.is_file():
            return None
        stamp = self._read_stamp(stamp_path)
        whole = all((self.root / output).exists() for output in stamp["outputs"])
        return stamp if whole and stamp["fingerprint"] == fingerprint else None

    def _read_stamp(self, path: Path) -> dict[str, Any]:
        try:
            stamp = json.loads(path.read_text())
            return {name: stamp[name] for name in ("fingerprint", "outputs", "time")}
        except (ValueError, KeyError, TypeError):
            return {"fingerprint": "", "outputs": [], "time": {}}

    def _withdraw(self, stamp_path: Path) -> None:
        """Removes what an earlier run of a stage left, so that no stale file outlives it."""
        if not stamp_path.is_file():
            return
        outputs = self._read_stamp(stamp_path)["outputs"]
        stamp_path.unlink()
        for name in outputs:
            remove(self.root / name)

    def withdraw_others(self) -> None:
        """Removes the results of stages that an earlier run had and this one has not."""
        for stamp_path in (self.root / ".stages").glob("*.json"):
            if stamp_path.stem not in self._done:
                self._withdraw(stamp_path)

    def _partial(self, name: str, fingerprint: str) -> Path:
        """The stage's workshop, kept where it was left by the same stage with the same inputs."""
        mine = self.root / ".partial" / f"{name}-{fingerprint[:12]}"
        for other in (self.root / ".partial").glob(f"{name}-*"):
            if other != mine or self._force:
                shutil.rmtree(other)
        mine.mkdir(exist_ok=True)
        return mine

    def _publish(self, partial: Path) -> list[str]:
        names = sorted(path.name for path in partial.iterdir())
        for name in names:
            remove(self.root / name)
            (partial / name).replace(self.root / name)
        partial.rmdir()
        return names


def remove(path: Path) -> None:
    """Removes a file or a folder, if it is there."""
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def cpu_seconds() -> float:
    """CPU seconds of this process and its finished children."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def digest(content: bytes) -> str:
    """A hexadecimal SHA-256."""
    return hashlib.sha256(content).hexdigest()


def replace_text(path: Path, text: str) -> None:
    """Writes a text file at once or not at all."""
    with replacing(path) as unfinished:
        unfinished.write_text(text)


EDGE_BYTES = 1 << 20


def fingerprint_of(path: Path) -> str:
    """What tells a file or a folder of files from another: names, sizes, first and last MiB."""
    files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
    summary = hashlib.sha256()
    try:
        for file in files:
            size = file.stat().st_size
            summary.update(f"{file.relative_to(path.parent)} {size}".encode())
            with file.open("rb") as stream:
                summary.update(stream.read(EDGE_BYTES))
                stream.seek(max(0, size - EDGE_BYTES))
                summary.update(stream.read())
    except OSError as error:
        raise BadInputError(f"{error.filename}: cannot be read ({error.strerror})") from error
    return summary.hexdigest()
