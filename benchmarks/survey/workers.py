"""What the flights of a survey cost: by one process, by two, and by two of which one is killed.

    python -m benchmarks.survey workers OUT CAMPAIGN one --flights 8     # or two, or killed
    python -m benchmarks.survey workers OUT

The first does the first videos of CAMPAIGN, a folder of `locate simulate`; both print what is done.
Wall times say something on a machine that does nothing else.
"""

import argparse
import json
import os
import resource
import signal
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from unittest.mock import patch

from benchmarks.common.cost import folder_mib
from locate.map.plume import PlumeMap
from locate.survey import engine
from locate.survey.flights import FlightJob, RequestedFlight
from locate.survey.model import Flight, SurveySettings

WORKERS = {"one": 1, "two": 2, "killed": 2}
KILLED_IN = "detections 0"
MIB = 1 << 20
Answer = TypeVar("Answer")


@dataclass(frozen=True, kw_only=True)
class Measured(FlightJob):
    """The job, with a line in NOTES for every part begun and done."""

    notes: Path

    def do_part(self, given: RequestedFlight, name: str) -> str | None:
        return self._noted(given, name, lambda: FlightJob.do_part(self, given, name))

    def __call__(self, given: RequestedFlight) -> Flight:
        return self._noted(given, "end", lambda: FlightJob.__call__(self, given))

    def _noted(self, given: RequestedFlight, name: str, work: Callable[[], Answer]) -> Answer:
        about = {"flight": given.name, "part": name, "pid": os.getpid()}
        self._note(about)
        cpu = time.process_time()
        answer = work()
        spent = {
            "cpu_s": time.process_time() - cpu,
            "peak_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        }
        self._note(about | spent)
        return answer

    def _note(self, line: dict[str, Any]) -> None:
        with self.notes.open("a") as file:
            file.write(json.dumps(line) + "\n")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path)
    parser.add_argument("campaign", type=Path, nargs="?")
    parser.add_argument("mode", choices=WORKERS, nargs="?", default="one")
    parser.add_argument("--flights", type=int, default=8)


def main(options: argparse.Namespace) -> None:
    if options.campaign is not None:
        fly(options)
    show(options.out)


def fly(options: argparse.Namespace) -> None:
    """The flights of a campaign, in the processes of a mode."""
    campaign, mode = options.campaign, options.mode
    videos = sorted((campaign / "videos").glob("*.mkv"))[: options.flights]
    folder = (options.out / mode).resolve()
    folder.mkdir(parents=True)
    given = [
        RequestedFlight(name=video.stem, source=video.resolve(), folder=folder / video.stem)
        for video in videos
    ]
    settings = SurveySettings(camera=(campaign / "camera.json").resolve())
    job = Measured(settings=settings, notes=folder / "notes.jsonl")
    if mode == "killed":
        threading.Thread(target=kill_one, args=(job.notes,), daemon=True).start()
    start = time.perf_counter()
    with patch.object(engine, "count_cores", return_value=WORKERS[mode]):
        flights = [flight for _, flight in engine.map_flights(job, given, engine.LOCAL)]
    about = {
        "wall_s": time.perf_counter() - start,
        "load": os.getloadavg()[0],
        "failed": {flight.name: flight.failure for flight in flights if flight.failure},
    }
    (folder / "about.json").write_text(json.dumps(about))


def kill_one(notes: Path) -> None:
    """Kills the process that first begins `KILLED_IN`."""
    while True:
        for line in read(notes):
            if line["part"] == KILLED_IN:
                time.sleep(1.0)
                os.kill(line["pid"], signal.SIGKILL)
                return
        time.sleep(0.1)


def read(notes: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in notes.read_text().splitlines()] if notes.exists() else []


def show(out: Path) -> None:
    """Prints what stands in OUT."""
    maps: dict[str, list[Any]] = defaultdict(list)
    rates: dict[str, float] = {}
    for mode in WORKERS:
        folder = out / mode
        if not (folder / "about.json").exists():
            continue
        about, notes = json.loads((folder / "about.json").read_text()), read(folder / "notes.jsonl")
        done = [line for line in notes if "cpu_s" in line]
        cpu_s = sum(line["cpu_s"] for line in done)
        runs = [path.parent for path in sorted(folder.glob("*/map.json"))]
        for name, why in about["failed"].items():
            print(f"{mode}: {name} failed: {why}")
        if not runs:
            continue
        disk_mib = sum(map(folder_mib, runs))
        peak = max(line["peak_bytes"] for line in done)
        print(
            f"{mode}: {len(runs)} flights, wall {about['wall_s']:.0f} s at a load of "
            f"{about['load']:.1f}, {cpu_s / len(runs):.1f} CPU s a flight, parts begun "
            f"{len(notes) - len(done)} done {len(done)}, largest process {peak / MIB:.0f} MiB, "
            f"{disk_mib / len(runs):.1f} MiB a run folder"
        )
        rates[mode] = len(runs) / about["wall_s"]
        for run in runs:
            maps[run.name].append(PlumeMap.load(run / "map.json").to_dict())
        if mode == "one":
            stages(runs)
    if {"one", "two"} <= rates.keys():
        print(f"two workers do {rates['two'] / rates['one']:.2f} times the flights of one")
    same = [all(one == each[0] for one in each) for each in maps.values()]
    print(f"same map however it was made: {sum(same)} of {len(same)} flights")


def stages(runs: list[Path]) -> None:
    """CPU s of each stage, from the run folders of one process."""
    spent: dict[str, float] = defaultdict(float)
    frames = 0
    for run in runs:
        for line in read(run / "log.jsonl"):
            if "cpu_s" in line:
                spent[line["stage"]] += line["cpu_s"]
        frames += len(json.loads((run / "frames" / "index.json").read_text())["frames"])
    total = sum(spent.values())
    parts = ", ".join(f"{name} {cpu_s / len(runs):.1f}" for name, cpu_s in spent.items())
    print(f"  CPU s a flight: {parts}; {total / frames:.2f} a frame of {frames}")
