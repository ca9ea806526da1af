"""The topics of ROS 2 on plain DDS: their names, types and bytes, without anything of ROS.

ROS 2 writes topic /name as ``rt/name`` and type package/msg/Type as ``package::msg::dds_::Type_``;
the bytes are XCDR1, which `rosbags` reads and writes a hundred times faster than cyclonedds' own
Python. See https://design.ros2.org/articles/topic_and_service_names.html.
"""

import os
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from geometry.errors import BadInputError

if TYPE_CHECKING:
    from cyclonedds.qos import Qos
    from cyclonedds.sub import DataReader

NO_TYPE_INFORMATION = (
    "<CycloneDDS><Domain><Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation>"
    "</Compatibility></Domain></CycloneDDS>"
)
"""Fast DDS 3 (vendor 1.15) describes types in a way that cyclonedds takes for other types."""
MOST_AT_ONCE = 64
"""Messages of one topic that are read before the next topic (chosen)."""
SENSOR_DEPTH, DEPTH, LATCHED_DEPTH = 5, 100, 1
"""Messages that a queue keeps: 5 as ROS 2's sensor-data profile, the others chosen."""
BLOCKED_NS = 100_000_000
"""A full queue blocks a writer at most this long (the default of DDS)."""
PYTHON_TYPES = {"string": str, "bool": bool}


def _pass_bytes_through(idl_struct: Any) -> Any:
    """An IDL struct whose samples are their bytes, which cyclonedds then passes through."""

    def keep_bytes(sample: Any, data: bytes) -> None:
        sample.data = data

    idl_struct.__init__ = keep_bytes
    idl_struct.serialize = lambda sample, **_how: sample.data
    idl_struct.deserialize = classmethod(lambda cls, data, **_how: cls(data))
    idl_struct.deserialize_key = idl_struct.deserialize
    return idl_struct


class DdsTransport:
    """A robot's topics, over DDS.

    Args:
        domain: ROS_DOMAIN_ID of the robot.

    Attributes:
        types: The message classes, of `rosbags`.

    Raises:
        BadInputError: The extra `dds` is not installed, or there is no network to be on.
    """

    def __init__(self, domain: int = 0) -> None:
        try:
            from cyclonedds.core import DDSException, WaitSet
            from cyclonedds.domain import Domain, DomainParticipant
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise BadInputError('DDS needs an extra: pip install "plume-locate[dds]"') from error
        asked = os.environ.get("CYCLONEDDS_URI", "")
        try:
            self._domain = Domain(domain, ",".join(filter(None, [NO_TYPE_INFORMATION, asked])))
            self._participant: DomainParticipant = DomainParticipant(domain)
        except DDSException as error:
            raise BadInputError(f"DDS domain {domain} cannot be joined ({error})") from error
        self.types = get_typestore(Stores.LATEST)
        self._classes: dict[str, Any] = {}
        self._waiting = WaitSet(self._participant)
        self._readers: list[tuple[DataReader[Any], str, Callable[[Any], object]]] = []

    def subscribe(
        self,
        topic: str,
        type_name: str,
        on_message: Callable[[Any], object],
        *,
        reliable: bool = False,
        latched: bool = False,
    ) -> None:
        """Gives every message of a topic to `on_message`, from within `spin_once`.

        Args:
            topic: As ROS names it, ``"/camera/image_raw"``.
            type_name: Such as ``"sensor_msgs/msg/Image"``.
            on_message: Called with an object of `types`.
            reliable: Lost messages are sent again; otherwise QoS is that of sensor data.
            latched: Messages sent before are received, too.
        """
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.sub import DataReader

        reliable = reliable or latched
        qos = _make_qos(
            reliable=reliable, latched=latched, depth=DEPTH if reliable else SENSOR_DEPTH
        )
        reader = DataReader(self._participant, self._make_topic(topic, type_name), qos=qos)
        unread = SampleState.NotRead | ViewState.Any | InstanceState.Any
        self._waiting.attach(ReadCondition(reader, unread))
        self._readers.append((reader, type_name, on_message))

    def advertise(
        self, topic: str, type_name: str, *, latched: bool = True
    ) -> Callable[[Any], None]:
        """A function that sends messages on a reliable topic; late subscribers receive the last.

        Args:
            topic: As of `subscribe`.
            type_name: Likewise.
            latched: False where only those subscribed at the time receive them.
        """
        from cyclonedds.pub import DataWriter

        depth = LATCHED_DEPTH if latched else DEPTH
        qos = _make_qos(reliable=True, latched=latched, depth=depth)
        writer: DataWriter[Any] = DataWriter(
            self._participant, self._make_topic(topic, type_name), qos=qos
        )
        kind = self._message_struct(type_name)
        return lambda message: writer.write(
            kind(bytes(self.types.serialize_cdr(message, type_name)))
        )

    def spin_once(self, timeout_s: float, refuse: Callable[[str, BadInputError], object]) -> None:
        """Waits for messages, at most this long, and passes them to the subscribers.

        Args:
            timeout_s: How long to wait.
            refuse: Called with each message that cannot be read: what it was, and why.
        """
        from cyclonedds.internal import InvalidSample
        from rosbags.serde import SerdeError

        unreadable = (SerdeError, ValueError, IndexError, struct.error)
        self._waiting.wait(round(timeout_s * 1e9))
        for reader, type_name, on_message in self._readers:
            for sample in reader.take(MOST_AT_ONCE):
                if isinstance(sample, InvalidSample):
                    continue
                try:
                    message = self.types.deserialize_cdr(sample.data, type_name)
                except unreadable as error:
                    refuse("message", BadInputError(f"{type_name} cannot be read ({error})"))
                else:
                    on_message(message)

    def _make_topic(self, topic: str, type_name: str) -> Any:
        from cyclonedds.topic import Topic

        return Topic(self._participant, f"rt/{topic.lstrip('/')}", self._message_struct(type_name))

    def _message_struct(self, type_name: str) -> Any:
        """The IDL struct of a message, which cyclonedds wants in order to check its bytes."""
        from cyclonedds.idl import make_idl_struct

        if type_name not in self._classes:
            package, kind, name = type_name.split("/")
            fields = {
                field: self._field_type(node) for field, node in self.types.fielddefs[type_name][1]
            }
            dds_name = f"{package}.{kind}.dds_.{name}_"
            struct_of_it = make_idl_struct(f"{name}_", dds_name, fields, dataclassify=False)
            self._classes[type_name] = _pass_bytes_through(struct_of_it)
        return self._classes[type_name]

    def _field_type(self, node: Any) -> Any:
        """The IDL type of a field."""
        from cyclonedds.idl import types as idl
        from rosbags.interfaces import Nodetype

        kind, of = node
        if kind == Nodetype.NAME:
            return self._message_struct(of)
        if kind == Nodetype.BASE:
            return PYTHON_TYPES.get(of[0]) or getattr(idl, of[0])
        element, count = of
        many = self._field_type(element)
        generic: Any = idl
        return generic.array[many, count] if kind == Nodetype.ARRAY else generic.sequence[many]


def _make_qos(*, reliable: bool, latched: bool, depth: int) -> "Qos":
    from cyclonedds.qos import Policy, Qos

    return Qos(
        Policy.Reliability.Reliable(max_blocking_time=BLOCKED_NS)
        if reliable
        else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )
