"""Every planner on four arms that `cobot new-robot` makes, see `arm_kinds`.

Oracles: pinocchio's kinematics and dynamics of the given URDF, MuJoCo's distances, roots by numpy (see
`benchmarks.stress.judge`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cobot_run import WAIT_S
from converted_arms import Made, new_robot
from foreign_trajectories import totg
from rig import Rig
from servo_bench import Bench, runner

from benchmarks.arms import carrying
from benchmarks.stress.cases import CORRIDOR_RAD, Case
from benchmarks.stress.judge import Judge
from benchmarks.stress.run import Tally, one
from cobot.config import load_settings
from cobot.errors import LimitError, UnreachableError
from cobot.motions.constraints import Box, Cone, Constraints
from cobot.motions.points import WaypointRequest
from cobot.motions.requests import Arc, MotionRequest
from cobot.planners import plan
from cobot.planners.blending.joined import leg_of
from cobot.planners.blending.prolonged import begin_stretch, extend_stretch
from cobot.robot.description import load_robot
from cobot.robot.feasibility import check_efforts, check_limits
from cobot.robot.scene import Scene, SceneObject
from cobot.robot.tool import Tool
from cobot.types import Algorithm, PlannerName, Pose, Scaling, Synchronization, Waypoint

FULL = Scaling(1.0)


def require_planned(made: Made, kind: str, *requests: MotionRequest, scene: Scene | None = None) -> None:
    """That it is planned, and that the judge has nothing against the motion."""
    robot = made.arm.robot
    if scene is not None:
        robot = replace(robot, collision=robot.collision.among(scene))
    tally = Tally()
    one(made.arm, Case(0, kind, robot, requests), tally, share=0.0)
    assert tally.wrong == []
    assert tally.planned == 1, tally.refused


def test_ptp(made: Made) -> None:
    for goal in (made.moved(0.5, 0.2), made.pose(0.1, 0.05, -0.1, 0.3)):
        request = MotionRequest(made.ready, goal, PlannerName.PTP, FULL)
        require_planned(made, "ptp", request)
        require_planned(made, "ptp", replace(request, synchronization=Synchronization.PHASE))


def test_lin(made: Made) -> None:
    goal = made.pose(0.12, -0.08, -0.1, 0.4)
    require_planned(made, "lin", MotionRequest(made.ready, goal, PlannerName.LIN, FULL))


def test_circ(made: Made) -> None:
    start, goal = made.pose(0.0, 0.0, 0.0), made.pose(-0.1, 0.1, 0.0)
    via = made.pose(-0.02, 0.08, 0.0).position
    require_planned(made, "circ", MotionRequest(made.ready, goal, PlannerName.CIRC, FULL, via))
    arc = Arc(start.position + np.array([-0.05, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), 6.5, 0.05, False)
    require_planned(made, "circ", MotionRequest(made.ready, start, PlannerName.CIRC, FULL, arc=arc))


def test_polyline(made: Made) -> None:
    through = (made.pose(0.1, 0.0, 0.0, 0.2), made.pose(0.1, 0.1, -0.1, 0.2))
    goal = made.pose(0.1, 0.1, 0.0)
    request = MotionRequest(made.ready, goal, PlannerName.POLYLINE, FULL, through=through, radius_m=0.02)
    require_planned(made, "polyline", request)


@pytest.mark.parametrize("held", [False, True], ids=["free", "held"])
def test_joined_motions(made: Made, held: bool) -> None:
    near = made.moved(0.1, 0.05)
    low, high = made.ready[0] - 0.5, made.ready[0] + 0.5
    constraints = (
        Constraints(Cone(np.array([0.0, 0.0, 1.0]), 0.5), joints=((0, low, high),)) if held else None
    )
    require = (
        MotionRequest(made.ready, near, PlannerName.PTP, FULL, constraints=constraints),
        MotionRequest(near, made.pose(0.1, 0.05, -0.05, 0.2), PlannerName.LIN, FULL, constraints=constraints),
    )
    tally = Tally()
    one(made.arm, Case(0, "joined", made.arm.robot, require, radii_m=(0.03,)), tally, share=0.0)
    assert (tally.planned, tally.wrong) == (1, []), tally.refused


@pytest.mark.parametrize("planner", [PlannerName.OMPL, PlannerName.CHOMP, PlannerName.AUTO])
def test_around_a_box_in_the_way(made: Made, planner: PlannerName) -> None:
    goal = made.ready.copy()
    goal[int(made.slides.sum())] += 1.4  # the arm's first hinge
    between = Judge(made.arm, made.arm.robot).tcp(0.5 * (made.ready + goal))[0]
    x, y, z = between.tolist()
    scene = Scene(1, {"box": SceneObject("box", (0.1, 0.1, 0.1), (x, y, z, 1.0, 0.0, 0.0, 0.0))})
    request = MotionRequest(made.ready, goal, planner, FULL, seed=1, timeout_s=WAIT_S)
    require_planned(made, str(planner), request, scene=scene)


@pytest.mark.parametrize("algorithm", ["RRT", "BKPIECE1"])
def test_ompls_planners_by_name(made: Made, algorithm: Algorithm) -> None:
    goal = made.moved(0.4, 0.2)
    request = MotionRequest(
        made.ready, goal, PlannerName.OMPL, FULL, seed=1, timeout_s=WAIT_S, algorithm=algorithm
    )
    require_planned(made, "ompl", request)


@pytest.mark.parametrize("planner", [PlannerName.OMPL, PlannerName.AUTO, PlannerName.LIN])
def test_a_motion_that_keeps_constraints(made: Made, planner: PlannerName) -> None:
    goal = made.pose(0.1, -0.08, -0.05)
    here = made.pose(0.0, 0.0, 0.0).position
    held = Constraints(
        Cone(np.array([0.0, 0.0, 1.0]), 0.1),
        Box(here - 0.2, here + 0.2),
        ((0, float(made.ready[0]) - 1.0, float(made.ready[0]) + 1.0),),
    )
    request = MotionRequest(made.ready, goal, planner, FULL, seed=1, timeout_s=WAIT_S, constraints=held)
    require_planned(made, "constrained", request)


def test_a_motion_that_comes_while_the_arm_moves(made: Made) -> None:
    robot, start, legs = made.arm.robot, made.ready, []
    for goal in (made.pose(0.1, 0.0, -0.05), made.pose(0.1, 0.1, -0.1)):
        request = MotionRequest(start, goal, PlannerName.LIN, Scaling(0.3))
        motion = plan(robot, request)
        assert motion is not None
        legs.append(leg_of(robot, request, motion))
        start = motion.end
    first = begin_stretch(robot, legs[:1], [0.03])
    both = extend_stretch(robot, first, legs[1:], [0.0], 0.0, 0.2).trajectory
    assert list(Judge(made.arm, robot).flaws(both, robot.limits)) == []
    assert np.array_equal(both.sample([0.0, 0.1, 0.2]), first.trajectory.sample([0.0, 0.1, 0.2]))
    assert np.abs(both.end - start).max() < 1e-9


@pytest.mark.parametrize("mass_kg", [0.0, 2.0])
def test_timed_points_of_somebody_else(made: Made, mass_kg: float) -> None:
    robot = carrying(made.arm.robot, Tool(mass=mass_kg, centre=(0.0, 0.0, 0.1)))
    limits = made.arm.robot.limits
    signs = np.where(np.arange(limits.dof) % 2, -1.0, 1.0)
    there = made.moved(0.3, 0.1)
    corners = np.array([made.ready, there, there + signs * (there - made.ready)])
    rows = totg(corners, 0.7 * limits.max_velocity, 0.7 * limits.max_acceleration, 0.05)
    rows[[0, -1], 1 + limits.dof :] = 0.0
    times, q, v, a = rows[:, 0], *np.split(np.round(rows[:, 1:], 6), 3, axis=1)
    points = [
        Waypoint(q[i].tolist(), float(time), v[i].tolist(), a[i].tolist()) for i, time in enumerate(times)
    ]
    request = WaypointRequest(
        made.ready + 1e-5, points, 0.01, retime=mass_kg > 0.0, corridor_rad=CORRIDOR_RAD
    )
    tally = Tally()
    one(made.arm, Case(0, "timed", robot, timed=request), tally, share=0.0)
    assert (tally.planned, tally.wrong) == (1, []), tally.refused


BEYOND = [
    (0, 3.0, "joint position of a1 is 3 m, allowed: -0.6 to 0.6 m"),
    (0, 300.0, "these look like millimetres; positions of slides are in m"),
    (3, 30.0, "joint angle of a4 is 30 rad, allowed: -2.2 to 1.6 rad; these look like degrees"),
]


@pytest.mark.parametrize(("joint", "value", "said"), BEYOND)
def test_a_goal_beyond_the_limits_is_refused_in_the_joints_own_unit(
    gantry: Made, joint: int, value: float, said: str
) -> None:
    goal = gantry.ready.copy()
    goal[joint] = value
    with pytest.raises(LimitError) as refused:
        plan(gantry.arm.robot, MotionRequest(gantry.ready, goal, PlannerName.PTP, FULL))
    assert said in str(refused.value)
    assert [finding.unit for finding in refused.value.findings] == ["m" if joint < 2 else "rad"]


def test_a_slide_is_spoken_of_in_metres_and_newtons(gantry: Made) -> None:
    robot = gantry.arm.robot
    assert [robot.limits.unit(joint, 1) for joint in range(8)] == ["m/s"] * 2 + ["rad/s"] * 6
    goal = gantry.moved(0.0, 0.3)
    motion = plan(robot, MotionRequest(gantry.ready, goal, PlannerName.PTP, FULL))
    assert motion is not None
    with pytest.raises(LimitError, match=r"the velocity of a1 reaches -?\S+ m/s, but its limit is"):
        check_limits(motion, robot.limits.scaled(0.2, 1.0, 1.0))
    weak = replace(robot.limits, max_effort=0.05 * robot.limits.max_effort)
    with pytest.raises(LimitError, match=r"a1 needs \S+ N, but its limit is 1 N$"):
        check_efforts(robot.model, motion, replace(weak, max_effort=np.array([1.0, *[1e5] * 7])))


def test_a_servo_point_beyond_a_slides_end_is_refused_in_metres(gantry: Made) -> None:
    rig = Rig(gantry.settings, gantry.arm.robot, start=gantry.ready)

    async def test(bench: Bench) -> None:
        rig.describe(rig.loopback.nominal_stiffness)
        bench.set_mode(1)
        await bench.active()
        bench.point([2.0, *gantry.ready[1:]], point_type="joint")
        assert bench.servo.feedback()["last_refusal"] == "joint 1 must be from -0.6 to 0.6 m, got 2"
        bench.stop()
        await bench.idle()

    runner(rig, gantry.arm.robot, gantry.settings)(test)
    rig.close()


def test_a_line_ends_where_a_slide_ends_and_says_so_in_metres(tmp_path: Path) -> None:
    # A machine of three slides: no other joint can help it on.
    joints = zip(("x", "y", "z", "c", "b", "a"), ("1 0 0", "0 1 0", "0 0 1") * 2, strict=True)
    parts, parent = ['<robot name="m"><link name="base_link"/>'], "base_link"
    for name, axis in joints:
        kind = "prismatic" if name in "xyz" else "revolute"
        parts.append(
            f'<link name="{name}_link"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" '
            f'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="{name}" type="{kind}"><parent '
            f'link="{parent}"/><child link="{name}_link"/><axis xyz="{axis}"/>'
            '<limit lower="-0.5" upper="0.5" velocity="1" effort="200"/></joint>'
        )
        parent = f"{name}_link"
    new_robot(tmp_path / "machine.urdf", "".join([*parts, "</robot>"]), tmp_path / "made")
    robot = load_robot(load_settings(tmp_path / "made" / "cobot-setting.yaml"))
    here = robot.model.forward(np.zeros(6))
    goal = Pose(here.position + np.array([0.7, 0.0, 0.0]), here.quaternion)
    with pytest.raises(UnreachableError, match=r"x reaches its limit of 0\.5000 m"):
        plan(robot, MotionRequest(np.zeros(6), goal, PlannerName.LIN, FULL))
