"""Stamps far from those before: one wrong stamp, or a clock that was set."""

from typing import Generic, NamedTuple, TypeVar

NS_PER_S = 1_000_000_000
STEP_NS = 10 * NS_PER_S
"""A stamp that is further than this from the newest is checked by the next (chosen)."""
Message = TypeVar("Message")


class Admitted(NamedTuple, Generic[Message]):
    """What may be used.

    Attributes:
        messages: Of one stream, in the order in which they came.
        went_back: The clock went back before them, as in a replay.
    """

    messages: tuple[Message, ...]
    went_back: bool = False


class StampGate(Generic[Message]):
    """Holds a message whose stamp is far from the newest until the next one confirms it.

    A single wrong stamp is so left out, and a clock that was set costs nothing.

    Attributes:
        newest_ns: The latest stamp of what was admitted; None before the first.
        left_out: How many messages were not confirmed.
    """

    def __init__(self) -> None:
        self.newest_ns: int | None = None
        self.left_out = 0
        self._held: tuple[int, Message] | None = None

    def admit(self, stamp_ns: int, message: Message) -> Admitted[Message]:
        """Takes a message; returns what may be used now: none, it, or it and the one held."""
        held, self._held = self._held, None
        newest_ns = self.newest_ns
        if newest_ns is None or abs(stamp_ns - newest_ns) <= STEP_NS:
            self.left_out += held is not None
            self.newest_ns = max(stamp_ns, newest_ns or stamp_ns)
            return Admitted((message,))
        if held is not None and _goes_on(newest_ns, held[0], stamp_ns):
            self.newest_ns = max(held[0], stamp_ns)
            return Admitted((held[1], message), went_back=self.newest_ns < newest_ns)
        self.left_out += held is not None
        self._held = stamp_ns, message
        return Admitted(())


def _goes_on(before_ns: int, held_ns: int, stamp_ns: int) -> bool:
    """Whether a stamp confirms the one held: near it, or later in a slow stream."""
    return abs(stamp_ns - held_ns) <= STEP_NS or before_ns < held_ns < stamp_ns
