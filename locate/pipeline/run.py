"""The run: from a recording to a map, by stages that are joined by files."""

import logging
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from detect import registry
from detect.registry import DetectorChoice
from geometry.errors import BadInputError, RegistrationError, RegistrationFailure
from geometry.processes import ProcessesAhead
from geometry.reports import Report, ignore_report
from geometry.threads import with_one_thread
from locate.map.plume import PlumeMap
from locate.pipeline import decide, detections, frames, place, poses, publish
from locate.pipeline.config import RunConfig
from locate.pipeline.files import RunFiles
from locate.pipeline.fingerprint import fingerprint_path
from locate.pipeline.known_lengths import KnownLengths
from locate.pipeline.left_out import left_out_notes
from locate.pipeline.map_notes import full_size_notes
from locate.pipeline.more_frames import MoreFrames
from locate.pipeline.obstacles import foreseen_obstacles
from locate.pipeline.points import load_points
from locate.pipeline.run_folder import RunFolder
from locate.pipeline.side_by_side import expect_shares, measure_side_by_side
from locate.pipeline.source import RecordingSource
from locate.pipeline.stage import Stage
from locate.recording import KeyFrames, Recording
from locate.recording.posed_frames import PosedFrames
from locate.telemetry import read_telemetry

log = logging.getLogger("locate")


@dataclass(frozen=True, kw_only=True)
class MeasurementPlan:
    """What a detector is to measure.

    Attributes:
        key_frames: The frames of the run.
        posed: Those of them that are used, with their camera.
        detector: Measures them.
    """

    key_frames: KeyFrames
    posed: PosedFrames
    detector: DetectorChoice


class Run:
    """One recording on its way to a map.

    Args:
        config: The settings.
        output: The run folder.
        force: Do every stage again.
        report: Takes the progress of each stage.
        jobs: Processes and threads that work side by side; the results do not depend on it.

    Raises:
        BadInputError: Something given cannot be used.
    """

    def __init__(
        self,
        config: RunConfig,
        output: Path,
        *,
        force: bool = False,
        report: Report = ignore_report,
        jobs: int = 1,
    ) -> None:
        self.config = config
        check_weights(config)
        if config.telemetry is not None:
            read_telemetry(config.telemetry)
        self.source = RecordingSource.of(config)
        self.lengths = KnownLengths.of(config.board, config.distance)
        self.folder = RunFolder(output, force=force)
        self.files = RunFiles(output)
        self._report = report
        self._jobs = jobs
        self._ahead = ProcessesAhead()

    @with_one_thread
    def run(self) -> PlumeMap:
        """Does what is left to do, and returns the map.

        Raises:
            BadInputError: Something given cannot be used.
            RegistrationError: The frames could not be registered; the error says why.
        """
        with self.folder.hold():
            with self._ahead:
                self._start_ahead()
                key_frames = self._choose_frames()
                plan = self._plan_measurement(key_frames)
                self._measure(plan)
            self._fuse(plan)
            self._publish(plan)
            self.folder.withdraw_others()
            return PlumeMap.load(self.files.map)

    @with_one_thread
    def prepare(self, *, poses: bool = True, share: tuple[int, int] | None = None) -> None:
        """Does a part of what `run` does; `run` does the rest.

        Args:
            poses: Do the frames and the poses; else only the frames.
            share: (k, n): measure refraction in every n-th of the chosen frames from the k-th,
                which several processes may do at the same time; None in none.
        """
        with self.folder.hold(shared=share is not None):
            key_frames = self._choose_frames()
            if poses:
                plan = self._plan_measurement(key_frames)
                if share is not None:
                    self._measure(plan, share)

    def _start_ahead(self) -> None:
        """Starts other processes for what is probably left to do: their imports take a second."""
        if self._jobs < 2:
            return
        if not self.source.has_given_poses and not self.folder.was_done("poses"):
            poses.expect_reconstruction(self._ahead)
        if self.config.detector != "bos" and not self.folder.was_done("detections"):
            expect_shares(self._ahead, most=self.config.amounts.detection_frames, jobs=self._jobs)

    def _choose_frames(self) -> KeyFrames:
        recording = self.source.open_frames()
        self.source.check_given_files()
        self.folder.save_config(self.config.to_plain())
        at_rest = self._may_rest and self.folder.is_done(self._frame_stage(at_rest=True))
        key_frames = self._write_frames(recording, at_rest=at_rest)
        for obstacle in foreseen_obstacles(key_frames):
            log.warning("%s %s", obstacle.why, obstacle.remedy)
        return key_frames

    def _frame_stage(self, *, at_rest: bool) -> Stage:
        inputs = {**self.source.frame_inputs(), "at_rest": at_rest}
        return Stage(name="frames", inputs=inputs, code=(frames,))

    def _write_frames(self, recording: Recording, *, at_rest: bool) -> KeyFrames:
        self.folder.complete(
            self._frame_stage(at_rest=at_rest),
            lambda folder: frames.write_key_frames(
                recording,
                RunFiles(folder),
                max_frames=self.config.amounts.max_frames,
                at_rest=at_rest,
                shot=self.config.shot,
                report=self._report,
            ),
        )
        return KeyFrames.load(self.files.frame_index)

    @property
    def _may_rest(self) -> bool:
        """Whether a camera at rest can be made use of, if this turns out to be one."""
        return self.config.detector in ("auto", "dybs") and self.config.poses is None

    def _plan_measurement(self, key_frames: KeyFrames) -> MeasurementPlan:
        """Finds out whether the camera moved, registers the frames if so, chooses the detector."""
        found_at_rest = key_frames.static and self._may_rest
        if self.config.detector == "bos" or found_at_rest:
            return self._plan_at_rest(key_frames)
        try:
            self._register(key_frames)
        except RegistrationError as error:
            if not self._may_rest or error.failure is not RegistrationFailure.STATIC_CAMERA:
                raise
            # The frames were chosen as of a moving camera.
            recording = self.source.open_frames()
            return self._plan_at_rest(self._write_frames(recording, at_rest=True))
        return MeasurementPlan(
            key_frames=key_frames,
            posed=poses.frames_with_poses(self.files, key_frames),
            detector=choose_detector(self.config, "registered"),
        )

    def _plan_at_rest(self, key_frames: KeyFrames) -> MeasurementPlan:
        detector = choose_detector(self.config, "bos")
        posed = poses.frames_at_rest(self.source, key_frames, self.files.frames)
        if detector.name != "dybs":
            poses.check_rest(posed, self.config.recording)
        return MeasurementPlan(key_frames=key_frames, posed=posed, detector=detector)

    def _register(self, key_frames: KeyFrames) -> None:
        def build(folder: Path) -> str:
            given, target = self.source.given_poses(key_frames), RunFiles(folder)
            if given is not None:
                return poses.adopt_poses(given, key_frames, self.files, target)
            return poses.reconstruct_poses(
                self.source, key_frames, self.files, target, self._report, self._jobs, self._ahead
            )

        inputs = self.source.pose_inputs()
        self.folder.complete(
            Stage(name="poses", after=("frames",), inputs=inputs, code=(poses,)), build
        )
        placing = place.place_inputs(self.source)
        self.folder.complete(
            Stage(name="place", after=("poses",), inputs=placing, code=(place,)),
            lambda folder: place.place_run(
                self.source, key_frames, self.lengths, self.files, RunFiles(folder)
            ),
        )

    def _measure(self, plan: MeasurementPlan, share: tuple[int, int] | None = None) -> None:
        amounts = self.config.amounts

        def build(folder: Path) -> str:
            make = partial(
                registry.make_detector,
                plan.detector.name,
                neighbours=amounts.neighbours,
                points_in_world=load_points(self.files.points),
                weights=self.config.weights,
            )
            target, most = RunFiles(folder).detections, amounts.detection_frames
            if share is None:
                return measure_side_by_side(
                    plan.posed,
                    make,
                    target,
                    most=most,
                    jobs=self._jobs,
                    ahead=self._ahead,
                    report=self._report,
                )
            return detections.measure_frames(
                plan.posed, make(), target, most=most, report=self._report, share=share
            )

        inputs: dict[str, Any] = {
            "detector": plan.detector.name,
            "frames": amounts.detection_frames,
            "neighbours": amounts.neighbours,
            "camera": plan.posed.camera.to_dict(),
        }
        weights = plan.detector.weight_files(self.config.weights)
        if weights:
            inputs["weights"] = [fingerprint_path(path) for path in weights]
        after = ("frames",) if plan.posed.trajectory is None else ("frames", "place")
        stage = Stage(name="detections", after=after, inputs=inputs, code=(detections, registry))
        if share is None:
            self.folder.complete(stage, build)
        else:
            self.folder.begin(stage, build)

    def _fuse(self, plan: MeasurementPlan) -> None:
        at_rest = plan.posed.trajectory is None
        notes = (
            *self.source.focal_notes(plan.key_frames, at_rest=at_rest),
            *full_size_notes(plan.key_frames),
            *left_out_notes(plan.key_frames, plan.posed.indices, given=self.source.has_given_poses),
        )
        inputs = {
            "seed": self.config.seed,
            "notes": notes,
            "clutter_nats": plan.detector.clutter_nats,
            "displacement_frames": self.config.amounts.displacement_frames,
            "always": self._always_more,
        }
        self.folder.complete(
            Stage(name="fusion", after=("detections",), inputs=inputs, code=(decide, registry)),
            lambda folder: decide.write_map(
                self.files,
                RunFiles(folder),
                plan.posed,
                seed=self.config.seed,
                notes=(*notes, *plan.key_frames.warnings),
                foreseen=foreseen_obstacles(plan.key_frames),
                more=self._more_frames(plan),
                report=self._report,
            ),
        )

    @property
    def _always_more(self) -> bool:
        """Whether more frames are measured though the answer without them is sure."""
        return self.config.effort == "thorough"

    def _more_frames(self, plan: MeasurementPlan) -> MoreFrames | None:
        """How more frames are measured where the answer is unsure; None where none are."""
        amounts = self.config.amounts
        if plan.posed.trajectory is None or not plan.detector.has_information:
            return None
        if not amounts.displacement_frames:
            return None
        return MoreFrames(
            make=partial(
                registry.make_displacement_only,
                plan.detector.name,
                neighbours=amounts.neighbours,
                points_in_world=load_points(self.files.points),
            ),
            most=amounts.displacement_frames,
            always=self._always_more,
            jobs=self._jobs,
        )

    def _publish(self, plan: MeasurementPlan) -> None:
        self._report("report", -1)
        inputs = publish.publish_inputs(self.config)
        self.folder.complete(
            Stage(name="report", after=("fusion",), inputs=inputs, code=(publish,)),
            lambda folder: publish.publish(
                self.source,
                plan.key_frames,
                plan.posed,
                files=self.files,
                target=RunFiles(folder),
                stages=self.folder.times,
                jobs=self._jobs,
            ),
        )
        self._report("report", 1)


def check_weights(config: RunConfig) -> None:
    """Refuses weights that the detector cannot use, before anything is done.

    Raises:
        BadInputError: There are none, or they are another network's.
    """
    auto = config.detector == "auto"
    choice = DetectorChoice.parse("dybs" if auto else config.detector)
    if config.weights is not None and not choice.takes_weights:
        raise BadInputError(
            f"{config.weights}: {config.detector} has no weights; use --detector dybs or auto"
        )
    if config.weights is not None or not auto:
        choice.make(weights=config.weights)


def choose_detector(config: RunConfig, usual: str) -> DetectorChoice:
    """The detector asked for; ``auto`` takes the usual one, helped by dybs where it can."""
    if config.detector != "auto":
        return DetectorChoice.parse(config.detector)
    return DetectorChoice.parse(usual).helped_by_dybs(config.weights)
