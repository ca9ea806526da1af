"""Every kind of fault: what is done, how often it was survived, what was lost."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.common.cost import folder_mib
from benchmarks.faults.changes import at_change, fail, kill
from benchmarks.faults.trial import DisturbedRun, Whole, hurry

Loss = str
"""What went wrong; empty where nothing was lost."""
YEAR_S = 365 * 86400


def kill_at_random(whole: Whole, output: Path, tries: int, seed: int = 0) -> Iterator[Loss]:
    """SIGALRM, which ends a process as a kill does, at a random moment; then the run goes on."""
    moments = np.random.default_rng(seed).uniform(0, whole.seconds, 3 * tries)
    killed = 0
    for moment_s in moments:
        ending = whole.run(output, partial(signal.setitimer, signal.ITIMER_REAL, moment_s))
        if ending.code == -signal.SIGALRM:
            killed += 1
            yield whole.resume(output)
        elif ending.code:
            yield str(ending)
        shutil.rmtree(output)
        if killed == tries:
            return


def kill_at_changes(whole: Whole, output: Path, step: int) -> Iterator[Loss]:
    """A kill before every `step`-th change that Python makes to the folder."""
    number, code = 0, -signal.SIGKILL
    while code == -signal.SIGKILL:
        code = whole.run(output, at_change(output, number, kill)).code
        if code == -signal.SIGKILL:
            yield whole.resume(output)
        with suppress(FileNotFoundError):
            shutil.rmtree(output)
        number += step


def fail_at_changes(whole: Whole, output: Path, step: int) -> Iterator[Loss]:
    """Every change from some on fails (EIO, ENOSPC, EDQUOT, EROFS in turn); then it is mended."""
    numbers = (errno.EIO, errno.ENOSPC, errno.EDQUOT, errno.EROFS)
    number, failed = 0, True
    while failed:
        error = fail(numbers[number // step % len(numbers)])
        ending = whole.run(output, at_change(output, number, error))
        failed = ending.code != 0
        if failed:
            yield whole.resume(output) if ending.is_refusal else str(ending)
        with suppress(FileNotFoundError):
            shutil.rmtree(output)
        number += step


def damage_files(whole: Whole, output: Path, step: int) -> Iterator[Loss]:
    """Every `step`-th file of a finished run: half of it, one bit, all or the file itself gone."""
    names = sorted(
        path.relative_to(whole.folder) for path in whole.folder.rglob("*") if path.is_file()
    )
    for name in names[::step]:
        for damage in (_halve, _flip_bit, _empty, Path.unlink):
            shutil.copytree(whole.folder, output)
            damage(output / name)
            loss = whole.resume(output)
            yield loss and f"{name} {damage.__name__.strip('_')}: {loss}"
            shutil.rmtree(output)


def _halve(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def _flip_bit(path: Path) -> None:
    content = bytearray(path.read_bytes())
    if content:
        content[len(content) // 2] ^= 4
    path.write_bytes(content)


def _empty(path: Path) -> None:
    os.truncate(path, 0)


def fill_disk(whole: Whole, output: Path, tries: int) -> Iterator[Loss]:
    """A disk that is too small, and one that others fill while structure from motion writes."""
    whole_kib = round(folder_mib(whole.folder) * 1024)
    for share in np.linspace(0.02, 1.0, tries):
        yield _run_on_disk(whole, output, round(share * whole_kib), "")
    for delay_s in np.linspace(0.0, 0.6, tries):
        yield _run_on_disk(whole, output, 8 * whole_kib, OTHERS.format(delay_s=delay_s))


OTHERS = """
(until test -e "$0"/out/.partial/poses*/sfm/database.db; do sleep 0.02; done
sleep {delay_s:.2f}; cat /dev/zero > "$0"/others) 2>&- &
"""
ON_DISK = """
mount -t tmpfs -o size={size}k none "$0" && cd /
{meanwhile}
"$@"; first=$?
kill %1 2>&-; rm -f "$0"/others; mount -o remount,size=1g "$0"
"$@" || exit 97
cp -a "$0"/out "$0".kept; exit $first
"""


def _run_on_disk(whole: Whole, output: Path, size_kib: int, meanwhile: str) -> Loss:
    """In a name space of its own, where everybody may mount; twice, then on a larger disk."""
    script = ON_DISK.format(size=size_kib, meanwhile=meanwhile)
    program = f"from {hurry.__module__} import hurry; hurry()"
    places = [str(whole.recording), "-o", str(output / "out")]
    command = [sys.executable, "-c", program, "run", *places]
    kept = output.with_name(output.name + ".kept")
    output.mkdir()
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", script, output, *command],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    said = " ".join(done.stderr.split())[-300:]
    try:
        if done.returncode not in (0, 2) or "Traceback" in done.stderr:
            return f"{size_kib} KiB: exit code {done.returncode}, {said!r}"
        return whole.find_difference(kept)
    finally:
        shutil.rmtree(kept, ignore_errors=True)
        output.rmdir()


def refuse_folders(whole: Whole, output: Path, _: int) -> Iterator[Loss]:
    """A folder with a letter in it, a file in its place, one that may not be written."""
    output.mkdir()
    (output / "letter.txt").write_text("dear")
    ending = whole.run(output)
    intact = [path.name for path in output.iterdir()] == ["letter.txt"]
    yield "" if ending.is_refusal and intact else str(ending)
    shutil.rmtree(output)
    output.write_text("dear")
    ending = whole.run(output)
    yield "" if ending.is_refusal and output.read_text() == "dear" else str(ending)
    output.unlink()
    for finished in (False, True):
        if finished:
            shutil.copytree(whole.folder, output)
        else:
            output.mkdir()
        ending = whole.run(output, at_change(output, 0, fail(errno.EACCES)))
        intact = not finished or not whole.find_difference(output)
        yield "" if ending.is_refusal and intact else str(ending)
        shutil.rmtree(output)


def run_two_at_once(whole: Whole, output: Path, tries: int) -> Iterator[Loss]:
    """Two runs on one folder, the second some time after the first."""
    for share in np.linspace(0, 0.8, tries):
        first = DisturbedRun(whole.recording, output)
        time.sleep(share * whole.seconds)
        second = DisturbedRun(whole.recording, output)
        endings = sorted((one.end() for one in (first, second)), key=lambda one: one.code)
        fair = endings[0].code == 0 and (endings[1].code == 0 or endings[1].is_refusal)
        yield whole.find_difference(output) if fair else " / ".join(map(str, endings))
        shutil.rmtree(output)


def step_clock(whole: Whole, output: Path, _: int) -> Iterator[Loss]:
    """The clock is set by a year within a run; files that say they are from 1970 and 2100."""
    for years in (-1, 1, -60, 100):
        ending = whole.run(output, partial(_set_clock, years * YEAR_S))
        yield str(ending) if ending.code else whole.find_difference(output)
        for path in output.rglob("*"):
            os.utime(path, (0, 0) if years < 0 else (130 * YEAR_S, 130 * YEAR_S))
        yield whole.resume(output)
        shutil.rmtree(output)


def _set_clock(step_s: float) -> None:
    """From its hundredth reading on, the clock of this process is set."""
    true_time, read = time.time, 0

    def tell() -> float:
        nonlocal read
        read += 1
        return true_time() + (step_s if read > 100 else 0)

    time.time = tell


AT_RANDOM = "kills at random moments"
KINDS: dict[str, Callable[[Whole, Path, int], Iterator[Loss]]] = {
    AT_RANDOM: kill_at_random,
    "kills at changes of the folder": kill_at_changes,
    "errors from a change on": fail_at_changes,
    "a damaged file of a finished run": damage_files,
    "full disks": fill_disk,
    "folders that cannot be used": refuse_folders,
    "two runs on one folder": run_two_at_once,
    "clock steps": step_clock,
}
