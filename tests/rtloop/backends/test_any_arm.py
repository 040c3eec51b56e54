"""The simulated drives with arms that are lighter, heavier, thinner and stiffer than the iiwa.

Oracles: MuJoCo, which integrates the motion of each arm; pinocchio, which reads the same URDF; closed forms.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio
import pytest
import yaml
from extreme_arms import EXTREMES, extreme_robot, urdf
from thorough import few

from benchmarks.any_arm import measure
from cobot.config import Settings, load_settings
from cobot.robot.description import RobotDescription, load_robot
from cobot.types import Array
from rtloop.backends import Impedance, Measured
from rtloop.backends.mujoco import MujocoBackend

POSTURES, MOTIONS = 20, 6
PERIOD_S = 1e-3


class Arm:
    """A robot of `extreme_arms` and its simulation."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.folder = name, folder
        self.settings: Settings = load_settings(folder / "cobot-setting.yaml")
        self.robot: RobotDescription = load_robot(self.settings)
        self.dof = self.robot.limits.dof
        self.measured = Measured(self.dof)
        self.backend = MujocoBackend(self.settings, self.robot.limits)

    def postures(self, count: int) -> Array:
        """In the middle of the ranges, where no joint meets its stop."""
        limits, random = self.robot.limits, np.random.default_rng(1)
        return random.uniform(0.6 * limits.min_position, 0.6 * limits.max_position, (count, self.dof))

    def hold(self, posture: Array, cycles: int) -> None:
        command = np.zeros((3, self.dof))
        command[0] = posture
        for _ in range(cycles):
            self.backend.write(command)
        self.backend.read(self.measured)

    def springs(self, cartesian: bool, share: float) -> Impedance:
        backend = self.backend
        nominal = backend.nominal_cartesian_stiffness if cartesian else backend.nominal_stiffness
        return Impedance(cartesian, share * nominal, np.full(len(nominal), 0.7))


@pytest.fixture(scope="module", params=few(sorted(EXTREMES), 2))
def arm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Arm:
    name = str(request.param)
    return Arm(name, extreme_robot(name, tmp_path_factory.mktemp(name)))


def test_it_holds_still_everywhere_and_completes_motions_at_full_speed(arm: Arm) -> None:
    found = measure(arm.folder, postures=POSTURES, motions=MOTIONS)
    assert found.postures == (POSTURES, POSTURES)
    assert found.payload_kg >= 0.25 * EXTREMES[arm.name].payload_kg
    assert found.still == (1.0, 1.0), found
    assert found.faults == (), found
    assert sum(found.completed.values()) + sum(found.refused.values()) == MOTIONS
    assert min(found.completed.values()) > 0, found
    assert found.tracking_ratio <= 1.0, found


def test_an_arm_without_limits_but_its_efforts_is_followed(tmp_path: Path) -> None:
    """Its accelerations are such that every plan needs what the drives have; oracle: MuJoCo."""
    folder = extreme_robot("light", tmp_path)
    file = folder / "joint_limits.yaml"
    limits = yaml.safe_load(file.read_text(encoding="utf-8"))
    for joint in limits["joint_limits"].values():
        joint |= {"max_acceleration": 4e3, "max_jerk": 4e5}
    file.write_text(yaml.safe_dump(limits), encoding="utf-8")
    found = measure(folder, postures=POSTURES, motions=12)
    assert found.faults == (), found
    assert found.tracking_ratio <= 1.0, found


def test_what_holds_it_is_the_weight_that_pinocchio_finds(arm: Arm) -> None:
    other = pinocchio.buildModelFromXML(urdf(arm.name))
    data = other.createData()
    for posture in arm.postures(5):
        weight = pinocchio.computeGeneralizedGravity(other, data, posture)
        if (np.abs(weight) > 0.9 * arm.robot.limits.max_effort).any():
            continue
        arm.backend.open(posture)
        arm.hold(posture, 300)
        scale = float(np.abs(weight).max()) + 1e-3
        np.testing.assert_allclose(arm.measured.effort, weight, atol=1e-6 * scale)


@pytest.mark.parametrize("cartesian", [False, True])
def test_springs_of_the_nominal_stiffness_bring_it_to_rest(arm: Arm, cartesian: bool) -> None:
    for posture in arm.postures(10):
        weight = np.abs(arm.robot.model.gravity_torques(posture)) / arm.robot.limits.max_effort
        if weight.max() > 0.7:
            continue
        arm.backend.open(posture)
        arm.backend.set_impedance(arm.springs(cartesian, 1.0))
        arm.backend._data.qvel[:] = 0.05
        arm.hold(posture, 2500)
        speed = np.abs(arm.measured.velocity).max()
        arm.backend.set_impedance(None)
        assert speed < 5e-3, posture


def test_a_damper_for_each_joint_by_itself_would_be_unstable() -> None:
    """The law was chosen for arms such as this one: with the dampers of 60 rad/s and 0.7 on the current
    diagonal of its inertia, a cycle of 1 ms would multiply some velocity by less than -1.
    """
    other = pinocchio.buildModelFromXML(urdf("lossy"))
    data, worst = other.createData(), 0.0
    for posture in np.random.default_rng(2).uniform(-2.6, 2.6, (200, other.nv)):
        inertia = pinocchio.crba(other, data, posture)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        rates = np.linalg.eigvals(np.linalg.solve(inertia, np.diag(inertia.diagonal()))).real
        worst = max(worst, 2.0 * 0.7 * 60.0 * float(rates.max()) * PERIOD_S)
    assert worst > 2.0


def test_friction_and_damping_of_the_file_act_on_an_arm_that_gives_way(tmp_path: Path) -> None:
    """Closed form: the torque that dry friction and damping leave to a joint in steady motion."""
    arm = Arm("lossy", extreme_robot("lossy", tmp_path))
    posture, last = np.zeros(arm.dof), arm.dof - 1
    arm.backend.open(posture)
    arm.backend.set_impedance(arm.springs(False, 1e-3))
    torque = 5.0
    arm.backend._data.qfrc_applied[last] = torque
    arm.hold(posture, 300)
    model = arm.robot.model.mj  # that of the folder, which `cobot new-robot` may have given less of both
    rubbing = 0.1 * model.dof_frictionloss[last]  # the drives make up for nine tenths
    expected = (torque - rubbing) / model.dof_damping[last]
    assert model.dof_damping[last] > 1.0
    assert arm.measured.velocity[last] == pytest.approx(expected, rel=0.03)
    arm.backend._data.qfrc_applied[last] = 0.0
