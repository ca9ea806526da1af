"""The run: from a recording to a map, by stages that are joined by files."""

import errno
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

from geometry.camera import Camera
from geometry.errors import BadInputError, RegistrationError, RegistrationFailure
from geometry.named_poses import resized
from geometry.pose_files import read_named_poses
from geometry.sfm import reconstruct
from geometry.trajectory import Trajectory
from locate.config import RunConfig
from locate.decide import decide
from locate.journal import Report, silent
from locate.observe import Recorded, observe
from locate.plume import PlumeMap
from locate.publish import publish
from locate.run_folder import RunFolder, fingerprint_of
from locate.video import KeyFrames, open_recording, select_frames

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
    _detector: str

    def __init__(
        self, config: RunConfig, output: Path, *, force: bool = False, report: Report = silent
    ) -> None:
        self.config = config
        self.folder = RunFolder(output, force=force)
        self.root = output
        self._report = report

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

    def _frames(self) -> None:
        config = self.config
        recording = open_recording(config.recording, max_side=config.max_side)
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

        inputs = {
            "recording": fingerprint_of(config.recording),
            "max_frames": config.max_frames,
            "max_side": config.max_side,
        }
        self.folder.stage("frames", inputs=inputs, build=build)
        self._key_frames = KeyFrames.load(self.root / "frames" / "index.json")

    def _known_camera(self) -> Camera | None:
        """The camera of the kept frames, where the user gave one."""
        if self.config.camera is None:
            return None
        try:
            content = json.loads(self.config.camera.read_text())
            camera = Camera.from_dict(content.get("camera", content))
            return resized(camera, self._key_frames.width, self._key_frames.height)
        except (OSError, ValueError, AttributeError, BadInputError) as error:
            raise BadInputError(f"{self.config.camera}: not a camera file ({error})") from error

    def _focal_prior_px(self) -> float | None:
        if self.config.focal_px is None:
            return self._key_frames.focal_prior_px
        own_width = open_recording(self.config.recording, max_side=1 << 30).width
        return self.config.focal_px * self._key_frames.width / own_width

    def _recorded(self) -> Recorded:
        """The frames with all that is known of their camera and its poses."""
        asked, frames = self.config.detector, self._key_frames
        self._detector = "registered" if asked == "auto" else asked
        if asked == "bos" or (asked == "auto" and frames.static and self.config.poses is None):
            return self._still()
        try:
            self._find_poses()
        except RegistrationError as error:
            if asked == "auto" and error.failure is RegistrationFailure.STATIC_CAMERA:
                return self._still()
            raise
        trajectory = Trajectory.load(self.root / "trajectory.json")
        names = dict(zip(frames.indices.tolist(), frames.names, strict=True))
        return Recorded(
            folder=self.root / "frames",
            names=[names[index] for index in trajectory.indices.tolist()],
            indices=trajectory.indices,
            camera=trajectory.camera,
            trajectory=trajectory,
        )

    def _still(self) -> Recorded:
        """The frames of a camera at rest, for the bos detector."""
        self._detector = "bos"
        frames, camera = self._key_frames, self._known_camera()
        if camera is None:
            focal_px = self._focal_prior_px() or GUESSED_FOCAL * max(frames.width, frames.height)
            camera = Camera.pinhole(frames.width, frames.height, focal_px)
        recorded = Recorded(
            folder=self.root / "frames",
            names=frames.names,
            indices=frames.indices,
            camera=camera,
        )
        drift_px = recorded.drift_px()
        if drift_px > MOVING_SHARE * frames.width:
            raise BadInputError(
                f"{self.config.recording}: bos needs a camera at rest and the image moves by "
                f"{drift_px:.0f} px; use --detector registered"
            )
        return recorded

    def _find_poses(self) -> None:
        config = self.config
        inputs: dict[str, Any] = {
            name: None if path is None else fingerprint_of(path)
            for name, path in (("poses", config.poses), ("camera", config.camera))
        }
        inputs["focal_px"] = config.focal_px
        build = self._register if config.poses is None else self._take_given_poses
        self.folder.stage("poses", after=("frames",), inputs=inputs, build=build)

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
        result.trajectory.save(folder / "trajectory.json")
        return f"{len(result.trajectory)} of {len(frames)} frames, {result.report['method']}"

    def _take_given_poses(self, folder: Path) -> str:
        assert self.config.poses is not None
        frames = self._key_frames
        trajectory, _ = read_named_poses(self.config.poses, self._known_camera()).match_to_frames(
            [frame.source for frame in frames.frames],
            frames.indices,
            frames.times_s,
            size=(frames.width, frames.height),
        )
        trajectory.save(folder / "trajectory.json")
        return f"{len(trajectory)} of {len(self._key_frames)} frames, given"

    def _detect(self, recorded: Recorded) -> None:
        def build(folder: Path) -> str:
            return observe(
                recorded,
                self._detector,
                folder / "detections",
                points_path=self.root / "sfm" / "points.npz",
                most=self.config.detection_frames,
                report=self._report,
            )

        inputs = {
            "detector": self._detector,
            "frames": self.config.detection_frames,
            "camera": recorded.camera.to_dict(),
        }
        after = ("frames",) if recorded.trajectory is None else ("frames", "poses")
        self.folder.stage("detections", after=after, inputs=inputs, build=build)

    def _decide(self, recorded: Recorded) -> None:
        def build(folder: Path) -> str:
            plume_map = decide(
                self.root / "detections",
                recorded,
                folder / "evidence.npz",
                seed=self.config.seed,
                report=self._report,
            )
            plume_map = replace(
                plume_map,
                notes=(*plume_map.notes, *self._focal_notes(), *self._key_frames.warnings),
            )
            plume_map.save(folder / "map.json")
            return f"{len(plume_map.plumes)} plumes, {len(plume_map.bearings)} bearings"

        inputs = {"seed": self.config.seed, "notes": self._focal_notes()}
        self.folder.stage("fusion", after=("detections",), inputs=inputs, build=build)

    def _focal_notes(self) -> tuple[str, ...]:
        known = self.config.camera or self.config.poses or self.config.focal_px
        if known or self._key_frames.focal_prior_px is not None:
            return ()
        how = "guessed" if self._detector == "bos" else "estimated from the frames"
        return (f"The focal length is {how}; give it with --focal or --camera if you know it.",)

    def _publish(self, recorded: Recorded) -> None:
        self._report("report", -1)
        self.folder.stage(
            "report",
            after=("fusion",),
            inputs={},
            build=lambda folder: publish(
                self.root,
                folder,
                recorded,
                stages=self.folder.times,
                settings=self.config.to_plain(),
            ),
        )
        self._report("report", 1)
