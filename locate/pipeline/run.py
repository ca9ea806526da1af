"""The run: from a recording to a map, by stages that are joined by files."""

import errno
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

from detect.registry import DetectorChoice
from geometry.camera import Camera
from geometry.errors import BadInputError, RegistrationError, RegistrationFailure
from geometry.named_poses import NamedPoses, read_camera, resized
from geometry.pose_files import read_named_poses
from geometry.sfm import reconstruct
from geometry.threads import with_one_blas_thread
from geometry.trajectory import Trajectory
from locate.journal.progress import Report, silent
from locate.map.plume import PlumeMap
from locate.pipeline.config import RunConfig
from locate.pipeline.decide import METHOD, decide
from locate.pipeline.known_lengths import KnownLengths
from locate.pipeline.observe import WHOLE, Recorded, load_points, observe, save_points
from locate.pipeline.place import Placement, place, telemetry_of
from locate.pipeline.publish import publish
from locate.pipeline.run_folder import RunFolder, fingerprint_of
from locate.recording import KeyFrames, Recording, open_recording, select_frames
from locate.recording.bag import bag_of
from locate.recording.recording import ANY_SIDE
from locate.telemetry import read_telemetry

GUESSED_FOCAL = 1.2
MOVING_SHARE = 0.02
SFM_BYTES_PER_FRAME = 1_000_000


class Run:
    """One recording on its way to a map.

    Args:
        config: What was asked for.
        output: The run folder.
        force: Do every stage again.
        report: Told how far each stage is.
    """

    _key_frames: KeyFrames
    _detector: DetectorChoice
    _at_rest = False

    def __init__(
        self, config: RunConfig, output: Path, *, force: bool = False, report: Report = silent
    ) -> None:
        self.config = config
        self._check_weights()
        if config.telemetry is not None:
            read_telemetry(config.telemetry)
        self._bag = bag_of(config)
        self._lengths = KnownLengths.of(config.board, config.distance)
        self.folder = RunFolder(output, force=force)
        self.root = output
        self._report = report

    def _check_weights(self) -> None:
        config = self.config
        auto = config.detector == "auto"
        choice = DetectorChoice.parse("dybs" if auto else config.detector)
        if config.weights is not None and not choice.takes_weights:
            raise BadInputError(
                f"{config.weights}: {config.detector} has no weights; use --detector dybs or auto"
            )
        if config.weights is not None or not auto:
            choice.make(weights=config.weights)

    @with_one_blas_thread
    def run(self) -> PlumeMap:
        """Does what is left to do, and returns the map.

        Raises:
            BadInputError: Something given cannot be used.
            RegistrationError: The frames could not be registered; the error says why.
        """
        self._frames()
        recorded = self._recorded()
        self._detect(recorded)
        self._decide(recorded)
        self._publish(recorded)
        self.folder.withdraw_others()
        return PlumeMap.load(self.root / "map.json")

    @with_one_blas_thread
    def prepare(self, *, poses: bool = True, share: tuple[int, int] | None = None) -> None:
        """Does a part of what `run` does; `run` does the rest.

        Args:
            poses: Do the frames and the poses; else only the frames.
            share: (k, n): measure refraction in every n-th of the chosen frames from the k-th,
                which several processes may do at the same time; None in none.
        """
        self._frames()
        if poses:
            recorded = self._recorded()
            if share is not None:
                self._detect(recorded, share)

    def _frames(self) -> None:
        config = self.config
        recording = self._open(config.max_side)
        self.folder.save_config(config.to_plain())

        def build(folder: Path) -> str:
            frames = select_frames(
                recording,
                folder / "frames",
                max_frames=config.max_frames,
                progress=lambda _, share: self._report("frames", share),
            )
            frames.save(folder / "frames" / "index.json")
            motion = "camera at rest" if frames.static else "moving camera"
            return f"{len(frames)} of {frames.width}x{frames.height} px, {motion}"

        inputs: dict[str, Any] = {
            "recording": fingerprint_of(config.recording),
            "max_frames": config.max_frames,
            "max_side": config.max_side,
        }
        if self._bag is not None:
            inputs["image_topic"] = config.image_topic
        self.folder.stage("frames", inputs=inputs, build=build)
        self._key_frames = KeyFrames.load(self.root / "frames" / "index.json")

    def _open(self, max_side: int) -> Recording:
        if self._bag is not None:
            return self._bag.recording(max_side=max_side)
        return open_recording(self.config.recording, max_side=max_side)

    def _known_camera(self) -> Camera | None:
        """The camera of the kept frames, where the user or the bag gave one."""
        size = self._key_frames.width, self._key_frames.height
        if self.config.camera is not None:
            return read_camera(self.config.camera, *size)
        if self._bag is not None and self._bag.camera is not None:
            return resized(self._bag.camera, *size)
        return None

    def _focal_prior_px(self) -> float | None:
        if self.config.focal_px is None:
            return self._key_frames.focal_prior_px
        own_width = self._open(ANY_SIDE).width
        return self.config.focal_px * self._key_frames.width / own_width

    def _recorded(self) -> Recorded:
        """The frames with all that is known of their camera and its poses."""
        asked, frames = self.config.detector, self._key_frames
        may_rest = asked in ("auto", "dybs")
        if asked == "bos" or (may_rest and frames.static and self.config.poses is None):
            return self._still()
        try:
            self._find_poses()
        except RegistrationError as error:
            if may_rest and error.failure is RegistrationFailure.STATIC_CAMERA:
                return self._still()
            raise
        self._detector = self._chosen("registered")
        trajectory = Trajectory.load(self.root / "trajectory.json")
        return Recorded(
            folder=self.root / "frames",
            names=self._names_of(trajectory),
            indices=trajectory.indices,
            camera=trajectory.camera,
            trajectory=trajectory,
        )

    def _names_of(self, trajectory: Trajectory) -> list[str]:
        names = dict(zip(self._key_frames.indices.tolist(), self._key_frames.names, strict=True))
        return [names[index] for index in trajectory.indices.tolist()]

    def _still(self) -> Recorded:
        """The frames of a camera at rest."""
        self._at_rest = True
        self._detector = self._chosen("bos")
        frames, camera = self._key_frames, self._known_camera()
        if camera is None:
            focal_px = self._focal_prior_px() or GUESSED_FOCAL * max(frames.width, frames.height)
            camera = Camera.pinhole(frames.width, frames.height, focal_px)
        recorded = Recorded(
            folder=self.root / "frames",
            names=frames.names,
            indices=frames.indices,
            camera=camera,
            times_s=frames.times_s if frames.is_video else None,
        )
        drift_px = recorded.drift_px()
        if self._detector.name != "dybs" and drift_px > MOVING_SHARE * frames.width:
            raise BadInputError(
                f"{self.config.recording}: bos needs a camera at rest and the image moves by "
                f"{drift_px:.0f} px; use --detector registered"
            )
        return recorded

    def _chosen(self, usual: str) -> DetectorChoice:
        """The detector asked for; ``auto`` takes the usual one, helped by dybs where it can."""
        if self.config.detector != "auto":
            return DetectorChoice.parse(self.config.detector)
        return DetectorChoice.parse(usual).helped_by_dybs(self.config.weights)

    def _find_poses(self) -> None:
        config = self.config
        inputs: dict[str, Any] = {
            name: None if path is None else fingerprint_of(path)
            for name, path in (("poses", config.poses), ("camera", config.camera))
        }
        inputs["focal_px"] = config.focal_px
        if self._bag is not None:
            inputs["pose_topic"] = config.pose_topic
            inputs["world_frame"] = config.world_frame

        def build(folder: Path) -> str:
            given = self._given_poses()
            return self._register(folder) if given is None else self._take(given, folder)

        self.folder.stage("poses", after=("frames",), inputs=inputs, build=build)
        self._place()

    def _given_poses(self) -> NamedPoses | None:
        """Those of the user's file or of the bag."""
        if self.config.poses is not None:
            return read_named_poses(self.config.poses, self._known_camera())
        return None if self._bag is None else self._bag.poses(self._known_camera())

    def _register(self, folder: Path) -> str:
        frames = self._key_frames
        if shutil.disk_usage(folder).free < len(frames) * SFM_BYTES_PER_FRAME:
            raise OSError(errno.ENOSPC, "too little space for structure from motion", str(folder))
        shutil.rmtree(folder / "sfm", ignore_errors=True)
        result = reconstruct(
            self.root / "frames",
            frames.names,
            frames.indices,
            frames.times_s,
            camera=self._known_camera(),
            focal_prior_px=self._focal_prior_px(),
            workdir=folder / "sfm",
            ordered=frames.is_video,
            progress=lambda _, share: self._report("poses", share),
        )
        result.save(folder / "sfm")
        return f"{len(result.trajectory)} of {len(frames)} frames, {result.report['method']}"

    def _take(self, given: NamedPoses, folder: Path) -> str:
        frames = self._key_frames
        trajectory, _ = given.match_to_frames(
            [frame.source for frame in frames.frames],
            frames.indices,
            frames.times_s,
            size=(frames.width, frames.height),
        )
        (folder / "sfm").mkdir(exist_ok=True)
        trajectory.save(folder / "sfm" / "trajectory.json")
        return f"{len(trajectory)} of {len(self._key_frames)} frames, given"

    def _place(self) -> None:
        """Turns and scales the reconstruction to what telemetry says of it."""
        config = self.config
        beside = self._bag is None or config.telemetry is not None
        telemetry = telemetry_of(config.recording, config.telemetry) if beside else ()
        inputs = {
            "telemetry": [fingerprint_of(path) for path in telemetry],
            "camera_height_m": config.camera_height_m,
            "board": config.board,
            "distance": None if config.distance is None else fingerprint_of(config.distance),
        }

        def build(folder: Path) -> str:
            trajectory = Trajectory.load(self.root / "sfm" / "trajectory.json")
            points = load_points(self.root / "sfm" / "points.npz")
            placement = place(
                trajectory,
                self._key_frames,
                telemetry,
                asked=config.telemetry is not None,
                camera_height_m=config.camera_height_m,
                points_in_world=points,
                lengths=self._lengths.scales(
                    trajectory, self.root / "frames", self._names_of(trajectory)
                ),
            )
            placement.save(folder / "placement.json")
            placement.moved(trajectory).save(folder / "trajectory.json")
            if points is not None:
                save_points(folder / "points.npz", placement.moved_points(points))
            return placement.summary()

        self.folder.stage("place", after=("poses",), inputs=inputs, build=build)

    def _detect(self, recorded: Recorded, share: tuple[int, int] | None = None) -> None:
        def build(folder: Path) -> str:
            detector = self._detector.make(
                points_in_world=load_points(self.root / "points.npz"),
                weights=self.config.weights,
            )
            return observe(
                recorded,
                detector,
                folder / "detections",
                most=self.config.detection_frames,
                report=self._report,
                share=share or WHOLE,
            )

        inputs: dict[str, Any] = {
            "detector": self._detector.name,
            "frames": self.config.detection_frames,
            "camera": recorded.camera.to_dict(),
        }
        weights = self._detector.weight_files(self.config.weights)
        if weights:
            inputs["weights"] = [fingerprint_of(path) for path in weights]
        after = ("frames",) if recorded.trajectory is None else ("frames", "place")
        do = self.folder.stage if share is None else self.folder.begin
        do("detections", after=after, inputs=inputs, build=build)

    def _decide(self, recorded: Recorded) -> None:
        def build(folder: Path) -> str:
            plume_map = decide(
                self.root / "detections",
                recorded,
                folder / "evidence.npz",
                seed=self.config.seed,
                report=self._report,
            )
            placement = Placement.load(self.root / "placement.json")
            plume_map = placement.widened(plume_map)
            notes = (*placement.notes, *self._focal_notes(), *self._key_frames.warnings)
            plume_map = replace(plume_map, notes=(*plume_map.notes, *notes))
            plume_map.save(folder / "map.json")
            return f"{len(plume_map.plumes)} plumes, {len(plume_map.bearings)} bearings"

        inputs = {
            "seed": self.config.seed,
            "notes": self._focal_notes(),
            "method": [fingerprint_of(path) for path in METHOD],
            "clutter_nats": self._detector.clutter_nats,
        }
        self.folder.stage("fusion", after=("detections",), inputs=inputs, build=build)

    def _focal_notes(self) -> tuple[str, ...]:
        config = self.config
        known = config.camera or config.poses or config.focal_px
        known = known or (self._bag is not None and self._bag.camera is not None)
        if known or self._key_frames.focal_prior_px is not None:
            return ()
        how = "guessed" if self._at_rest else "estimated from the frames"
        return (f"The focal length is {how}; give it with --focal or --camera if you know it.",)

    def _publish(self, recorded: Recorded) -> None:
        self._report("report", -1)

        def build(folder: Path) -> str:
            said = publish(
                self.root,
                folder,
                recorded,
                stages=self.folder.times,
                settings=self.config.to_plain(),
            )
            if self._bag is not None and self.config.poses is None:
                plume_map = PlumeMap.load(self.root / "map.json")
                last = self._key_frames.frames[-1].source
                said += ", plumes.mcap" * self._bag.write(plume_map, folder / "plumes", last)
            return said

        self.folder.stage("report", after=("fusion",), inputs={}, build=build)
        self._report("report", 1)
