"""The message of a cycle. Oracles: the text of cobot_msgs/msg/Cycle that recordings have always had;
`rosbags`, which reads the messages by that text.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cobot.ipc.layout import GripperObject
from cobot.ipc.records import TIMED, record_dtype
from cobot.ipc.state_fields import CYCLE as CYCLE_TOPIC
from cobot.ipc.state_fields import GRIPPER_FIELDS, STATE_FIELDS
from cobot.recording.messages import _OWN, _PHASES, CYCLE, DEFINITIONS, GRIPPER, RecordMessages

FIELDS = (
    "std_msgs/Header header\nuint64 cycle\nfloat64 robot_time_s\nuint8 mode\nuint8 motion_result\n"
    "bool settled\nbool measured\nuint64 motion_id\nuint64 session\nfloat64 path_time_s\n"
    "float64 path_rate\nuint32 overruns\nuint32 interventions\nuint32 wakeup_ns\nuint32 read_ns\n"
    "uint32 update_ns\nuint32 write_ns\n"
    "geometry_msgs/Pose tcp\nfloat64[] external_effort\ngeometry_msgs/Wrench sensor\n"
)
CYCLES = 20
PERIOD_S = 0.001


def records(dof: int) -> np.ndarray:
    """Random ones, with a gripper; what is true or false is 0 or 1."""
    random, made = np.random.default_rng(dof), np.zeros(CYCLES, record_dtype(dof))
    for name in made.dtype.names:
        place = made[name]
        if place.dtype.kind == "f":
            place[...] = random.normal(size=place.shape)
        else:
            place[...] = random.integers(0, 2 if name in ("settled", "fresh") else 100, place.shape)
    made["gripper_object"] |= 1
    return made


def flat(message: Any) -> list[float]:
    """The numbers of a ROS message in the order of its fields."""
    if not hasattr(message, "__dataclass_fields__"):
        return [float(number) for number in np.atleast_1d(message)]
    names = [name for name in message.__dataclass_fields__ if name != "__msgtype__"]
    return [number for name in names for number in flat(getattr(message, name))]


def test_the_fields_of_a_cycle_are_those_that_readers_know_in_their_order() -> None:
    published = DEFINITIONS[CYCLE]
    assert FIELDS in published, "new fields come after these"
    assert published.index(FIELDS) > published.index("INTERVENTION_")


def test_a_place_in_the_message_belongs_to_one_field() -> None:
    names = [line.split()[1] for line in DEFINITIONS[CYCLE].splitlines() if "=" not in line]
    assert len(set(names)) == len(names)
    places = [place for place, type_, name in _OWN if name not in _PHASES[1:]]
    places += [field.message[0] for field in STATE_FIELDS if field.message and field.topic == CYCLE_TOPIC]
    assert sorted(places) == list(range(1, len(places) + 1)), "the next one is free"


def test_a_reader_finds_the_state_of_the_gripper() -> None:
    """Oracle: the reader of rosbags, with the definition that is in a file."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(DEFINITIONS[GRIPPER], GRIPPER))
    written = records(7)
    written["gripper_moving"] %= 2
    content, size = RecordMessages([f"joint{number}" for number in range(7)], "base", PERIOD_S).of(
        written, ahead_ns=5
    )["/gripper"]
    names = [line.split()[1] for line in DEFINITIONS[GRIPPER].splitlines() if "=" not in line]
    assert names == ["header", *(field.name for field in GRIPPER_FIELDS if field.message)]
    for index, record in enumerate(written):
        read = store.deserialize_cdr(content[index * size : (index + 1) * size], GRIPPER)
        assert [getattr(read, name) for name in names[1:]] == [record[name].item() for name in names[1:]]
        stamp = read.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == record["monotonic_ns"] + 5
    assert read.OBJECT_HELD_INSIDE == GripperObject.HELD_INSIDE


def test_without_a_gripper_there_is_no_message_of_one() -> None:
    written = records(2)
    written["gripper_object"] = GripperObject.ABSENT
    topics = RecordMessages(["a", "b"], "base", PERIOD_S).of(written, ahead_ns=0)
    assert list(topics) == ["/joint_states", "/commanded", "/wrench", "/cycle"]


def test_a_reader_finds_the_numbers_of_the_record() -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(DEFINITIONS[CYCLE], CYCLE))
    for dof in (1, 6, 7, 16):
        written = records(dof)
        names = [f"joint{number}" for number in range(dof)]
        content, size = RecordMessages(names, "base", PERIOD_S).of(written, ahead_ns=0)["/cycle"]
        for index, record in enumerate(written):
            read = store.deserialize_cdr(content[index * size : (index + 1) * size], CYCLE)
            assert read.cycle == record["number"]
            assert read.robot_time_s == record["number"] * PERIOD_S
            assert read.measured == bool(record["fresh"])
            assert read.interventions == record["interventions"]
            times = [getattr(read, f"{phase.name.lower()}_ns") for phase in TIMED]
            assert times == record["phases_ns"].tolist()
            for field in STATE_FIELDS:
                if field.message and field.topic == CYCLE_TOPIC:
                    numbers = np.atleast_1d(record[field.name]).tolist()
                    if field.message[1] == "geometry_msgs/Pose":
                        numbers = [*numbers[:3], *numbers[4:], numbers[3]]
                    assert flat(getattr(read, field.name)) == numbers, field.name
