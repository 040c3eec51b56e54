"""What every kind of arm can do: twelve arms that `cobot new-robot` makes, see `arm_kinds`; on virtual time.

Oracles: pinocchio's kinematics and dynamics of the given URDF with the other joints locked, and what
`benchmarks.stress.judge` computes without cobot; the commanded positions, and the limits.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio
import pytest
from arm_kinds import KINDS
from converted_arms import Made
from rig import Rig

from benchmarks.stress.cases import Case
from benchmarks.stress.judge import Judge
from benchmarks.stress.run import Tally, one
from cobot.ipc.layout import Interpolation
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.trajectory import Trajectory
from cobot.types import Array, LoopMode, PlannerName, Pose, Scaling

FULL = Scaling(1.0)
LOWERED = 0.08
"""Share of the reach by which a straight line goes inwards and down."""
SETTLED_RAD = 2e-3
"""Also in m for slides."""


@pytest.fixture
def kind_rig(kind: Made) -> Iterator[Rig]:
    rig = Rig(kind.settings, kind.arm.robot, simulated=True, start=kind.ready)
    yield rig
    rig.close()


def planned(kind: Made, start: Array, goal: Array | Pose, planner: PlannerName) -> Trajectory:
    """That the judge has nothing against it; seeded."""
    request = MotionRequest(start, goal, planner, FULL, seed=1)
    tally = Tally()
    one(kind.arm, Case(0, str(planner), kind.arm.robot, (request,)), tally, share=0.0)
    assert (tally.planned, tally.wrong) == (1, []), tally.refused
    motion = plan(kind.arm.robot, request)
    assert motion is not None
    return motion


def test_the_twelve_are_of_different_kinds() -> None:
    joints = {name: len(kind.joints) for name, kind in KINDS.items()}
    assert len(joints) == 12
    assert set(joints.values()) == {4, 5, 6, 7, 8}


def test_kinematics_and_dynamics_are_those_of_the_file(kind: Made) -> None:
    robot, model, judge = kind.arm.robot, kind.arm.model, Judge(kind.arm, kind.arm.robot)
    limits, data = robot.limits, kind.arm.model.createData()
    assert limits.dof == model.nq
    armature = robot.model.mj.dof_armature
    rng = np.random.default_rng(7)
    for joints in rng.uniform(limits.min_position, limits.max_position, (10, limits.dof)):
        position, _ = judge.tcp(joints)
        pose = robot.model.forward(joints)
        np.testing.assert_allclose(pose.position, position, atol=2e-6)
        assert judge.off(joints, pose) < 2e-6
        still = np.zeros(limits.dof)
        torques = pinocchio.rnea(model, data, joints, still, still)
        np.testing.assert_allclose(robot.model.gravity_torques(joints), torques, rtol=1e-4, atol=1e-4)
        if KINDS[kind.arm.name].build.inertia is not None:
            continue  # no body has such inertias, so cobot has replaced some
        mass = pinocchio.crba(model, data, joints)
        mass = np.triu(mass) + np.triu(mass, 1).T + np.diag(armature)
        np.testing.assert_allclose(robot.model.mass_matrix(joints), mass, rtol=1e-4, atol=1e-4 * mass.max())


def test_ptp_and_lin_are_planned_and_followed_at_full_speed(kind: Made, kind_rig: Rig) -> None:
    rig, away = kind_rig, kind.moved(-0.25, 0.05)
    motions = [
        planned(kind, kind.ready, away, PlannerName.PTP),
        planned(kind, away, kind.ready, PlannerName.PTP),
        planned(kind, kind.ready, kind.lowered(LOWERED), PlannerName.LIN),
    ]
    for motion in motions:
        assert rig.start(motion) == ""
        rig.run()
        assert rig.mode is LoopMode.HOLD, rig.reason
        rig.step(200)
        measured = rig.memory.state.data["position"][: rig.limits.dof]
        assert np.abs(measured - motion.end).max() < SETTLED_RAD
    assert rig.counted() == {}
    assert Judge(kind.arm, kind.arm.robot).off(motions[-1].end, kind.lowered(LOWERED)) < 2e-4


def test_ompl_goes_around_itself_and_its_surroundings(kind: Made) -> None:
    away = kind.ready.copy()
    away[int(kind.slides[0]) + int(kind.slides[:2].all())] += 0.9
    planned(kind, kind.ready, away, PlannerName.OMPL)


def test_it_holds_still_in_random_postures(kind: Made) -> None:
    robot, rng = kind.arm.robot, np.random.default_rng(3)
    low, high = robot.limits.min_position, robot.limits.max_position
    free = (
        joints
        for joints in rng.uniform(low, high, (200, robot.limits.dof))
        if robot.collision.is_free(joints)
    )
    for joints in (next(free) for _ in range(3)):
        rig = Rig(kind.settings, robot, simulated=True, start=joints)
        try:
            rig.step(400)
            assert rig.mode is LoopMode.HOLD, rig.reason
            measured = rig.memory.state.data["position"][: robot.limits.dof]
            assert np.abs(measured - joints).max() < SETTLED_RAD
            assert np.abs(rig.memory.state.data["velocity"][: robot.limits.dof]).max() < 1e-2
        finally:
            rig.close()


def test_a_stream_of_joints_is_followed(kind: Made, kind_rig: Rig) -> None:
    rig, size = kind_rig, np.where(kind.slides, 0.02, 0.06)
    soft = {
        "stiffness": 0.5 * rig.simulation.nominal_stiffness,
        "cartesian_stiffness": 0.5 * rig.simulation.nominal_cartesian_stiffness,
    }
    assert rig.stream(interpolation=Interpolation.QUINTIC, **soft) == ""
    for cycle in range(900):
        if cycle % 10 == 0:
            rig.aim(joints=kind.ready + size * (1.0 - np.cos(np.pi * cycle / 900)))
        rig.step()
    np.testing.assert_allclose(rig.commanded[-1], kind.ready + 2.0 * size, atol=2e-3)
    assert rig.counted() == {}
    rig.end_stream()
    rig.run()
    assert rig.mode is LoopMode.HOLD, rig.reason
