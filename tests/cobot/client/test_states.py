"""States of a client of the robot. Oracle: rotations and vectors of scipy and numpy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cobot.client.states import robot_states
from cobot.ipc.state_fields import state_dtype
from cobot.pose import Pose

DOF = 7
SEED = 20261128


@pytest.fixture
def state() -> np.ndarray:
    random = np.random.default_rng(SEED)
    record = np.zeros((), state_dtype(DOF))
    record["tcp"] = [*random.normal(size=3), *Rotation.random(rng=random).as_quat(scalar_first=True)]
    record["wrench"] = random.normal(size=6)
    return record


def test_the_flange_is_where_the_tcp_and_the_tool_have_it(state: np.ndarray) -> None:
    random = np.random.default_rng(SEED + 1)
    turn = Rotation.random(rng=random)
    offset = random.normal(size=3)
    flange_in_tcp = Pose(offset, turn.as_quat(scalar_first=True))
    x, y, z, *found = robot_states(state, flange_in_tcp).flange_pose
    tcp_turn = Rotation.from_quat(state["tcp"][3:], scalar_first=True)
    assert [x, y, z] == pytest.approx(state["tcp"][:3] + tcp_turn.apply(offset), abs=1e-12)
    assert (Rotation.from_quat(found, scalar_first=True).inv() * tcp_turn * turn).magnitude() < 1e-7


def test_the_wrench_is_reported_along_the_axes_of_the_base_and_of_the_tcp(state: np.ndarray) -> None:
    states = robot_states(state, Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])))
    back = Rotation.from_quat(state["tcp"][3:], scalar_first=True).inv()
    assert states.ext_wrench_in_world == state["wrench"].tolist()
    expected = np.concatenate([back.apply(state["wrench"][:3]), back.apply(state["wrench"][3:])])
    assert states.ext_wrench_in_tcp == pytest.approx(expected, abs=1e-12)
