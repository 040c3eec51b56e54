"""The positions in the state of a joint trajectory controller.

Oracle: rosbags writes the messages from their whole definitions, of Jazzy and of a later release with a field
more.
"""

from __future__ import annotations

import random

import numpy as np
import pytest
from real_ros import CONTROLLER_STATE
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cobot.dds.controller_state import TYPE, measured_positions
from cobot.errors import InputError

NAMES = ["shoulder", "elbow", "wrist 1"]


def message(definition: str, positions: list[float], *, little: bool) -> bytes:
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(definition, TYPE))
    kinds = store.types
    duration = kinds["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)

    def point(values: list[float]) -> object:
        rows = {"velocities": [0.5] * len(values), "accelerations": [], "effort": []}
        numbers = {name: np.array(each) for name, each in ({"positions": values} | rows).items()}
        return kinds["trajectory_msgs/msg/JointTrajectoryPoint"](**numbers, time_from_start=duration)

    nothing = kinds["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"](
        transforms=[], velocities=[], accelerations=[], time_from_start=duration
    )
    stamp = kinds["builtin_interfaces/msg/Time"](sec=12, nanosec=34)
    fields = {
        "header": kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="odd"),
        "joint_names": NAMES,
        "reference": point([9.0] * 3),
        "feedback": point(positions),
        "error": point([]),
        "output": point([]),
        "multi_dof_joint_names": [],
        **{f"multi_dof_{row}": nothing for row in ("reference", "feedback", "error", "output")},
    }
    if "speed_scaling_factor" in definition:
        fields["speed_scaling_factor"] = 1.0
    return bytes(store.serialize_cdr(kinds[TYPE](**fields), TYPE, little_endian=little))


@pytest.mark.parametrize("little", [True, False])
@pytest.mark.parametrize("more", ["", "float64 speed_scaling_factor\n"])
def test_it_reads_what_the_controller_measures(little: bool, more: str) -> None:
    content = message(CONTROLLER_STATE + more, [0.1, -0.2, 0.3], little=little)
    assert measured_positions(content) == dict(zip(NAMES, [0.1, -0.2, 0.3], strict=True))


def test_what_is_no_state_is_rejected() -> None:
    """Cut anywhere before the end of the second point, with fewer positions than joints, and random."""
    content = message(CONTROLLER_STATE, [0.1, -0.2, 0.3], little=True)
    for end in range(0, 150, 3):
        with pytest.raises(InputError):
            measured_positions(content[:end])
    with pytest.raises(InputError, match="3 joints and 2 positions"):
        measured_positions(message(CONTROLLER_STATE, [0.1, -0.2], little=True))
    draw = random.Random(3)
    for _ in range(300):
        with pytest.raises(InputError):
            measured_positions(b"\0\1\0\0" + draw.randbytes(draw.randrange(200)))
