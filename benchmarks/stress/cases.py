"""Random requests to every planner. Each request depends only on the seed, the arm and a number."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from foreign_trajectories import totg

from benchmarks.arms import NAMES as ARMS
from benchmarks.arms import SHIPPED, Arm, carrying
from cobot.motions.constraints import Box, Cone, Constraints
from cobot.motions.points import WaypointRequest
from cobot.motions.requests import Arc, MotionRequest, TcpSpeed
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene, SceneObject
from cobot.robot.tool import Tool
from cobot.types import Array, PlannerName, Pose, Scaling, Synchronization, Waypoint

KINDS = ("ptp", "lin", "circ", "polyline", "ompl", "chomp", "auto", "joined", "constrained", "timed")
TIMEOUT_S = 5.0
FAR_M = 5.0
CORRIDOR_RAD = 1e-3
SHIPPED_KG, MADE_KG, CENTRE_M = 14.0, 4.0, 0.2
"""The heaviest load of an arm, and how far its centre is from the flange at the most."""
TENS, LOADED_TEN = 5, 2
"""Of so many times ten requests those of this one have a load."""


@dataclass(frozen=True, slots=True)
class Case:
    """One request. `joined` has several motions, one after the other; `timed` has timed points."""

    number: int
    kind: str
    robot: RobotDescription
    requests: tuple[MotionRequest, ...] = ()
    radii_m: tuple[float, ...] = ()
    timed: WaypointRequest | None = None


def case(arm: Arm, number: int, seed: int) -> Case:
    """The request with this number. Requests whose numbers are equal modulo ten are for the same planner."""
    return _Maker(arm, number, seed).case(number)


class _Maker:
    def __init__(self, arm: Arm, number: int, seed: int) -> None:
        self.random = np.random.default_rng([seed, ARMS.index(arm.name), number])
        self.limits = arm.robot.limits
        self.robot = arm.robot
        if self.random.random() < 0.6:
            self.robot = replace(arm.robot, collision=arm.robot.collision.among(self._scene()))
        if number // len(KINDS) % TENS == LOADED_TEN:
            self.robot = carrying(self.robot, self._tool(SHIPPED_KG if arm.name == SHIPPED else MADE_KG))

    def case(self, number: int) -> Case:
        kind = KINDS[number % len(KINDS)]
        start = self._start()
        if kind == "timed":
            return Case(number, kind, self.robot, timed=self._timed(self._free()))
        if kind == "joined":
            legs, radii = self._chain(self._free())
            return Case(number, kind, self.robot, legs, radii)
        planner = PlannerName(kind if kind != "constrained" else str(self.random.choice(PLANNERS)))
        request = self._of(planner, start)
        if kind == "constrained":
            request = replace(request, constraints=self._constraints(start))
        return Case(number, kind, self.robot, (request,))

    def _scene(self) -> Scene:
        """Boxes within the arm's reach."""
        objects = {}
        for index in range(self.random.integers(1, 5)):
            place = self.robot.model.forward(self._any()).position + self.random.normal(0.0, 0.1, 3)
            edges = tuple(self.random.uniform(0.05, 0.35, 3).tolist())
            turn = self.random.normal(size=4)
            x, y, z = place.tolist()
            w, i, j, k = (turn / np.linalg.norm(turn)).tolist()
            objects[f"box{index + 1}"] = SceneObject("box", edges, (x, y, z, w, i, j, k))
        return Scene(1, objects)

    def _tool(self, most_kg: float) -> Tool:
        x, y, z = self.random.uniform([-0.05, -0.05, 0.0], [0.05, 0.05, CENTRE_M]).tolist()
        return Tool(mass=float(self.random.uniform(0.3, 1.0)) * most_kg, centre=(x, y, z))

    def _any(self) -> Array:
        return self.random.uniform(self.limits.min_position, self.limits.max_position)

    def _free(self) -> Array:
        for _ in range(200):
            joints = self._any()
            if self.robot.collision.is_free(joints):
                return joints
        return joints

    def _start(self) -> Array:
        """A start position that is usually collision-free, sometimes random, and sometimes slightly beyond a
        limit.
        """
        draw = self.random.random()
        if draw > 0.95:
            return self._any()
        start = self._free()
        if draw < 0.03:
            joint = int(self.random.integers(len(start)))
            start[joint] = self.limits.max_position[joint] + self.random.uniform(0.0, 0.02)
        return start

    def _scaling(self) -> Scaling:
        random = self.random
        return Scaling(float(random.choice([0.1, 0.4, 1.0])), float(random.choice([0.0, 0.3, 1.0])))

    def _near(self, start: Array, most_m: float, turn: float) -> Pose:
        """A pose at a random distance from the pose of these joint positions."""
        here, way = self.robot.model.forward(start), self.random.normal(size=3)
        way *= self.random.uniform(0.02, most_m) / np.linalg.norm(way)
        return Pose(here.position + way, here.quaternion + turn * self.random.normal(size=4))

    def _pose(self, start: Array, near: float) -> Pose:
        """A goal pose: near the start in this share of all cases, otherwise at a random place within reach,
        and rarely out of reach.
        """
        draw = self.random.random()
        if draw < near:
            return self._near(start, 0.5, float(self.random.choice([0.0, 0.1, 0.3])))
        pose = self.robot.model.forward(self._any())
        if draw < 0.95:
            return pose
        return Pose(pose.position + np.array([FAR_M, 0.0, 0.0]), pose.quaternion)

    def _of(self, planner: PlannerName, start: Array) -> MotionRequest:
        seed = int(self.random.integers(1000))
        if planner in (PlannerName.LIN, PlannerName.CIRC, PlannerName.POLYLINE):
            pose = self._pose(start, 0.8)
            request = MotionRequest(start, pose, PlannerName.LIN, self._scaling(), seed=seed)
            if self.random.random() < 0.3:
                request = replace(request, tcp_speed=TcpSpeed(float(self.random.uniform(0.02, 0.5))))
            if planner is PlannerName.POLYLINE:
                through = tuple(self._near(start, 0.3, 0.1) for _ in range(self.random.integers(1, 4)))
                radius_m = float(self.random.choice([0.0, 0.02, 0.1]))
                return replace(request, planner=planner, through=through, radius_m=radius_m)
            return self._arc(request) if planner is PlannerName.CIRC else request
        goal = self._any() if self.random.random() < 0.5 else self._pose(start, 0.2)
        request = MotionRequest(start, goal, planner, self._scaling(), seed=seed, timeout_s=TIMEOUT_S)
        if planner is PlannerName.PTP and self.random.random() < 0.5:
            request = replace(request, synchronization=Synchronization.PHASE)
        return request

    def _arc(self, request: MotionRequest) -> MotionRequest:
        """Change a lin request to an arc, through a point or by an angle about an axis."""
        if self.random.random() < 0.6:
            via = self._near(request.start, 0.3, 0.0).position
            return replace(request, planner=PlannerName.CIRC, via=via)
        centre = self._near(request.start, 0.2, 0.0).position
        angle = float(self.random.uniform(-7.0, 7.0))
        rise = float(self.random.choice([0.0, 0.1]))
        turns = bool(self.random.random() < 0.3)
        arc = Arc(centre, self.random.normal(size=3), angle, rise, turns)
        return replace(request, planner=PlannerName.CIRC, arc=arc)

    def _chain(self, start: Array) -> tuple[tuple[MotionRequest, ...], tuple[float, ...]]:
        """A mixture of ptp and lin motions. Each leg's start is a guess, and only the start of the first leg
        counts.
        """
        legs, at = [], start
        for _ in range(self.random.integers(2, 5)):
            if self.random.random() < 0.5:
                at = np.clip(
                    at + self.random.normal(0.0, 0.4, len(at)),
                    self.limits.min_position,
                    self.limits.max_position,
                )
                legs.append(MotionRequest(start, at, PlannerName.PTP, self._scaling()))
            else:
                goal = self._near(at, 0.3, 0.1)
                legs.append(MotionRequest(start, goal, PlannerName.LIN, self._scaling()))
        radii = self.random.choice([0.0, 0.02, 0.05, 0.1], len(legs) - 1)
        return tuple(legs), tuple(radii.tolist())

    def _constraints(self, start: Array) -> Constraints:
        here, random = self.robot.model.forward(start), self.random
        cone = box = None
        joints: tuple[tuple[int, float, float], ...] = ()
        draw = int(random.integers(1, 8))
        if draw & 1:
            axis = random.normal(size=3)
            cone = Cone(axis / np.linalg.norm(axis), float(random.uniform(0.1, 1.0)))
        if draw & 2:
            box = Box(
                here.position - random.uniform(0.02, 0.6, 3), here.position + random.uniform(0.02, 0.6, 3)
            )
        if draw & 4:
            joint = int(random.integers(len(start)))
            low, high = start[joint] - random.uniform(0.02, 1.0), start[joint] + random.uniform(0.02, 1.0)
            joints = ((joint, float(low), float(high)),)
        return Constraints(cone, box, joints)

    def _timed(self, start: Array) -> WaypointRequest:
        """A trajectory that TOTG has timed, at a share of the limits and with rounded values. The arm is
        close to the first point.
        """
        limits, random = self.limits, self.random
        share = float(random.choice([0.3, 0.7, 1.0, 1.3]))
        legs = random.uniform(-0.6, 0.6, (random.integers(1, 5), limits.dof))
        corners = start + np.cumsum(np.vstack([np.zeros(limits.dof), legs]), axis=0)
        corners = np.clip(corners, limits.min_position, limits.max_position)
        corners[0] = start
        step_s = float(random.choice([0.1, 0.02]))
        rows = totg(corners, share * limits.max_velocity, share * limits.max_acceleration, step_s)
        rows[[0, -1], 1 + limits.dof :] = 0.0
        rows[:, 1:] = np.round(rows[:, 1:], int(random.choice([4, 6, 12])))
        times, q, v, a = rows[:, 0], *np.split(rows[:, 1:], 3, axis=1)
        rates = random.random() < 0.7
        points = [
            Waypoint(
                q[i].tolist(), float(t), v[i].tolist() if rates else None, a[i].tolist() if rates else None
            )
            for i, t in enumerate(times)
        ]
        beside = start + random.normal(0.0, 1e-5, limits.dof)
        return WaypointRequest(
            beside, points, 0.01, retime=bool(random.random() < 0.7), corridor_rad=CORRIDOR_RAD
        )


PLANNERS = ("ompl", "ompl", "auto", "lin", "ptp")
