"""TCP arcs: through a point, about a centre, or by an angle about an axis; also full circles and helices."""

from __future__ import annotations

import numpy as np

from cobot.errors import PlanningError
from cobot.findings import Finding
from cobot.motions.requests import Arc, MotionRequest
from cobot.planners.path.cartesian import follow
from cobot.planners.path.ends import end_of, follow_or_relax, full_turns, reachable
from cobot.planners.path.tcp_path import PLACES, TcpPath, least_turn, turn_between, turned
from cobot.robot.description import RobotDescription
from cobot.robot.quaternion import SMALL_RAD
from cobot.trajectory import Trajectory
from cobot.types import Array, Pose

NEAREST_POINTS_M = 1e-3
EQUAL_RADII_M = 1e-3
"""Tolerance for the difference between the radii at start and goal, and for the distance of the goal from the
plane. The path compensates for both evenly.
"""
PLACE_RAD, MAX_PLACES = 0.2, 400
MIN_SINE = 1e-3
"""If the sine of the angle at `via` is smaller, the three points are considered collinear."""


def plan_circ(robot: RobotDescription, request: MotionRequest) -> Trajectory | None:
    """An arc from the current pose of the TCP: through `via` to the goal, about `arc.centre` to the goal, or
    by an angle about an axis.

    Raises:
        PlanningError: the request defines no circle; see also `follow` and `end_of`.
    """
    assert isinstance(request.goal, Pose)
    start = robot.model.forward(request.start)
    if request.arc is not None and request.arc.angle_rad is not None:
        return _by_angle(robot, request, request.arc, request.arc.angle_rad, start)
    goal, end = end_of(robot, request, reachable(robot, request, start, request.goal))
    if request.arc is None:
        assert request.via is not None
        path = arc(start, request.via, goal, least_turn(robot))
    elif request.cyclic and request.arc.axis is not None:
        path = helix(start, request.arc, 2.0 * np.pi)
    else:
        path = arc_about(start, request.arc, goal, least_turn(robot))
    return follow(robot, request, path, end)


def _by_angle(
    robot: RobotDescription, request: MotionRequest, given: Arc, angle: float, start: Pose
) -> Trajectory | None:
    """An arc about an axis. Full turns end at the joint angles at which they began, unless the request
    demands otherwise.
    """
    turns = None if request.cyclic is False or request.end_joints is not None else full_turns(start, given)
    if turns is not None:
        path = helix(start, given, turns)
        return follow_or_relax(robot, request, path, request.start, required=request.cyclic is True)
    path = helix(start, given, angle)
    return follow(robot, request, path, end_of(robot, request, path.pose_at(1.0))[1])


def arc_about(start: Pose, given: Arc, goal: Pose, least_rad: float = SMALL_RAD) -> TcpPath:
    """An arc about a centre to the goal. With an axis it follows the right-hand rule; without an axis it
    takes the shorter way.

    Raises:
        PlanningError: start and goal are not equally far from the centre, or the three points define no
            plane.
    """
    x, to_goal = start.position - given.centre, goal.position - given.centre
    radii = np.linalg.norm(x), np.linalg.norm(to_goal)
    if min(radii) < NEAREST_POINTS_M or abs(radii[0] - radii[1]) > EQUAL_RADII_M:
        raise PlanningError(
            f"circ: the start is {1e3 * radii[0]:.2f} mm from the centre, and the goal "
            f"{1e3 * radii[1]:.2f} mm; these radii may differ by {1e3 * EQUAL_RADII_M:g} mm, and must "
            f"be at least {1e3 * NEAREST_POINTS_M:g} mm",
            findings=[
                _arc_finding("difference of the radii", float(abs(radii[0] - radii[1])), EQUAL_RADII_M)
            ],
        )
    normal = np.cross(x, to_goal) if given.axis is None else given.axis / np.linalg.norm(given.axis)
    if given.axis is None and np.linalg.norm(normal) < MIN_SINE * radii[0] * radii[1]:
        raise PlanningError(
            "circ: start, centre and goal are on one line; send an axis, which defines the plane of the arc, "
            "or via, a point on it",
            findings=[_arc_finding("sine of the arc", _sine(normal, x, to_goal), MIN_SINE, "")],
        )
    axis = normal / np.linalg.norm(normal)
    for name, way in (("start", x), ("goal", to_goal)):
        if abs(way @ axis) > EQUAL_RADII_M:
            raise PlanningError(
                f"circ: the {name} is {1e3 * abs(way @ axis):.2f} mm outside the plane of the arc, which is "
                f"normal to the axis; allowed: {1e3 * EQUAL_RADII_M:g} mm",
                findings=[_arc_finding("distance from the plane", abs(way @ axis), EQUAL_RADII_M)],
            )
    angle = float(np.arctan2(to_goal @ np.cross(axis, x), to_goal @ x) % (2.0 * np.pi))
    end = _circle(given.centre, x, axis, angle, np.zeros(3), np.array([1.0]))[0]
    turn = turn_between(start, goal)

    def poses(shares: Array) -> Array:
        positions = _circle(given.centre, x, axis, angle, goal.position - end, shares)
        return np.concatenate([positions, turned(start.quaternion, turn, shares, least_rad)], axis=1)

    return TcpPath("circ", poses, angle * float(radii[0]), float(np.linalg.norm(turn)), _places(angle))


def helix(start: Pose, given: Arc, angle: float) -> TcpPath:
    """An arc that turns by an angle (rad) about the axis through the centre. It can be a full circle or a
    helix.

    Raises:
        PlanningError: the axis is missing, or the TCP is on it.
    """
    if given.axis is None or np.linalg.norm(given.axis) < MIN_SINE:
        raise PlanningError(
            "circ: axis: is missing or zero; an arc by an angle needs one",
            findings=[_arc_finding("length of the axis", 0.0, MIN_SINE, "")],
        )
    axis = given.axis / np.linalg.norm(given.axis)
    along = (start.position - given.centre) @ axis * axis
    x = start.position - given.centre - along
    radius = float(np.linalg.norm(x))
    if radius < NEAREST_POINTS_M:
        raise PlanningError(
            f"circ: the TCP is {1e3 * radius:.2f} mm from the axis; an arc needs at least "
            f"{1e3 * NEAREST_POINTS_M:g} mm",
            findings=[_arc_finding("distance from the axis", radius, NEAREST_POINTS_M)],
        )
    turn = angle * axis if given.turns_tool else np.zeros(3)

    def poses(shares: Array) -> Array:
        positions = _circle(given.centre + along, x, axis, angle, given.rise_m * axis, shares)
        return np.concatenate([positions, turned(start.quaternion, turn, shares)], axis=1)

    length = float(np.hypot(angle * radius, given.rise_m))
    return TcpPath("circ", poses, length, float(np.linalg.norm(turn)), _places(angle))


def _arc_finding(quantity: str, value: float, limit: float, unit: str = "m") -> Finding:
    """The finding for an error about points that define no arc."""
    return Finding("path", quantity, float(value), limit, unit)


def _sine(normal: Array, first: Array, second: Array) -> float:
    """Sine of the angle between two vectors whose cross product is `normal`; 0 if either is the zero
    vector.
    """
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.linalg.norm(normal)) / size if size > 0.0 else 0.0


def _circle(centre: Array, x: Array, axis: Array, angle: float, rise: Array, shares: Array) -> Array:
    """Positions at shares of an angle measured from `x` and of a rise along the axis. Shape: (n, 3)."""
    angles, part = angle * shares[:, None], shares[:, None]
    return np.asarray(centre + np.cos(angles) * x + np.sin(angles) * np.cross(axis, x) + part * rise)


def _places(angle: float) -> int:
    return int(np.clip(np.ceil(abs(angle) / PLACE_RAD), PLACES, MAX_PLACES))


def arc(start: Pose, via: Array, goal: Pose, least_rad: float = SMALL_RAD) -> TcpPath:
    """The path of an arc through three points.

    Raises:
        PlanningError: two of the points coincide, or all three are on one line.
    """
    to_via, to_goal = via - start.position, goal.position - start.position
    for name, length in (
        ("via and the start", np.linalg.norm(to_via)),
        ("the goal and the start", np.linalg.norm(to_goal)),
        ("via and the goal", np.linalg.norm(via - goal.position)),
    ):
        if length < NEAREST_POINTS_M:
            raise PlanningError(
                f"circ: {name} are {1e3 * length:.2f} mm apart; an arc needs three distinct points",
                findings=[_arc_finding("distance of two points", float(length), NEAREST_POINTS_M)],
            )
    normal = np.cross(to_via, to_goal)
    area = float(np.linalg.norm(normal))
    if area < MIN_SINE * np.linalg.norm(to_via) * np.linalg.norm(via - goal.position):
        sine = _sine(normal, to_via, via - goal.position)
        raise PlanningError(
            "circ: start, via and goal are on one line; use lin",
            findings=[_arc_finding("sine of the angle at via", sine, MIN_SINE, "")],
        )
    # Circumcentre of a triangle that has one corner at the origin.
    towards = np.cross(normal, to_via) * (to_goal @ to_goal) + np.cross(to_goal, normal) * (to_via @ to_via)
    radius = towards / (2.0 * area**2)
    centre = start.position + radius
    axis = normal / area
    x, y = -radius, np.cross(axis, -radius)
    angle = float(np.arctan2((goal.position - centre) @ y, (goal.position - centre) @ x) % (2.0 * np.pi))
    turn = turn_between(start, goal)

    def poses(shares: Array) -> Array:
        positions = _circle(centre, x, axis, angle, np.zeros(3), shares)
        return np.concatenate([positions, turned(start.quaternion, turn, shares, least_rad)], axis=1)

    length_m = angle * float(np.linalg.norm(radius))
    return TcpPath("circ", poses, length_m, float(np.linalg.norm(turn)), _places(angle))
