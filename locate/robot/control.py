"""A node's switches and its health, whatever carries them."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from locate.robot.message_adapter import MessageAdapter
from locate.robot.message_builder import NodeHealth
from locate.robot.plume_tracks import TrackState
from locate.robot.publisher import PlumePublisher

COMMANDS = ("start", "stop", "save", "reset")


@dataclass(frozen=True, kw_only=True)
class CommandResult:
    """What became of a command.

    Attributes:
        success: It was done.
        message: In words.
    """

    message: str
    success: bool = True


class NodeControl:
    """Starts and stops a node, saves and forgets its plumes, and reports its health.

    Args:
        adapter: What takes the robot's messages.
        plume_publisher: Publishes the plumes.
        output: Folder that map.json is saved in.
        running: Whether it detects from the beginning.
    """

    def __init__(
        self,
        adapter: MessageAdapter,
        plume_publisher: PlumePublisher,
        *,
        output: Path,
        running: bool = True,
    ) -> None:
        self._adapter = adapter
        self._plume_publisher = plume_publisher
        self._output = output
        self._running = running
        self._ignored = 0

    def while_running(self, on_message: Callable[[Any], None]) -> Callable[[Any], None]:
        """The same function, which only counts its calls while the node is stopped."""

        def call_or_count(message: Any) -> None:
            if self._running:
                on_message(message)
            else:
                self._ignored += 1

        return call_or_count

    def run_command(self, name: str, stamp_ns: int) -> CommandResult:
        """Does one of `COMMANDS`.

        Args:
            name: Of the command.
            stamp_ns: Now.
        """
        if name in ("start", "stop"):
            self._running = name == "start"
            return CommandResult(message="running" if self._running else "stopped")
        if name == "reset":
            self._adapter.reset()
            self._plume_publisher.clear_plumes(stamp_ns)
            return CommandResult(message="forgotten")
        if name == "save":
            return self._save_map()
        return CommandResult(message=f"{name!r} is none of {', '.join(COMMANDS)}", success=False)

    def _save_map(self) -> CommandResult:
        if self._adapter.locator is None:
            return CommandResult(message="nothing to save: no camera_info yet", success=False)
        path = self._output.expanduser() / "map.json"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._adapter.locator.plume_map().save(path)
        except OSError as error:
            return CommandResult(message=f"{path}: {error.strerror}", success=False)
        return CommandResult(message=str(path))

    def report_health(self) -> NodeHealth:
        """What was fed, dropped and refused, and the first problem."""
        locator, known = self._adapter.locator, self._plume_publisher.known.values()
        values = {} if locator is None else asdict(locator.counts)
        values |= {f"refused_{name}": count for name, count in self._adapter.refusals.items()}
        values["ignored_while_stopped"] = self._ignored
        values["plumes"] = sum(update.state == TrackState.CONFIRMED for update in known)
        problem = self._adapter.find_problem() if self._running else "stopped"
        return NodeHealth(problem=problem, values=values)
