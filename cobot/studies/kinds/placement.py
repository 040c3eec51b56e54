"""Finds the placement of the base and of the tool's TCP that gives the largest reach or the shortest program.

A task is one placement. Objects and targets stay at their places, and the arm moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal, Self

import mujoco
import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from cobot.errors import InputError, LimitError, NotSupportedError, PlanningError
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene
from cobot.robot.tool import Tool
from cobot.studies.chunks import Columns
from cobot.studies.kinds.reach import ReachKernel
from cobot.studies.kinds.reach_space import Approach, Places, PlacesSpace, places_of
from cobot.studies.kinds.robot_study import RobotStudy
from cobot.studies.parameters.spaces import Value
from cobot.studies.programs.program_moves import (
    Program,
    StudyMove,
    nearest_program,
    plan_moves,
    plan_program,
)
from cobot.studies.study import Kernel
from cobot.types import Array, Pose

PARAMETERS = (
    "base_x_m",
    "base_y_m",
    "base_z_m",
    "base_yaw_rad",
    "tcp_x_m",
    "tcp_y_m",
    "tcp_z_m",
    "tcp_pitch_rad",
)
"""The parameters: the new base in the current base frame, and the new TCP in the current TCP's frame."""


class PlacementStudy(RobotStudy):
    """Finds the placement with the largest reach, or with the shortest program.

    Attributes:
        space: some of `PARAMETERS`.
        targets: places to reach, in the current base frame; for the metrics of reach.
        program: motions with poses in the current base frame; for the metric `duration_s`.
        metric: share: mean share of the orientations that are reached at the targets; manipulability: its
            mean, with 0 for a target that is not reached; duration_s: program duration.
    """

    first_chunk: ClassVar[int] = 2
    parameter_names: ClassVar[tuple[str, ...]] = PARAMETERS

    kind: Literal["placement"]
    metric: Literal["share", "manipulability", "duration_s"] = "share"
    targets: PlacesSpace | None = None
    method: Literal["ik", "free"] = "free"
    approach: Approach = "down"
    spins: Annotated[int, Field(ge=1, le=360)] = 1
    program: Program | None = None

    @model_validator(mode="after")
    def _require_consistency(self) -> Self:
        wanted = "program" if self.metric == "duration_s" else "targets"
        if getattr(self, wanted) is None:
            raise ValueError(f"{wanted}: is missing; the metric {self.metric} needs it")
        if self.metric == "duration_s" and "goal" not in self.model_fields_set:
            raise ValueError("goal: is missing; give min for the shortest program")
        return self

    def answer(self, columns: Columns) -> dict[str, Any]:
        answer = super().answer(columns)
        if "planned" in columns and not (columns["cause"] == "").any():
            answer["no placement can execute the program"] = nearest_program(columns, self.axes)
        elif _reaches_nothing(columns):
            for name in ("at", "trial", f"best {self.metric}"):  # no placement is better than any other
                answer.pop(name, None)
            gaps = np.asarray(columns["gap_m"], dtype=float)
            nearest = int(np.argmin(gaps))
            at = ", ".join(f"{name} {columns[name][nearest].item():.6g}" for name in self.axes)
            why = f"its targets are {gaps[nearest]:.3f} m beyond the reach on average"
            if not gaps[nearest] > 0.0:
                why = "joint limits or collisions prevent it"
            answer["no target is reached"] = f"the nearest placement is {at}: {why}"
        return answer

    def best_placement(self, columns: Columns) -> dict[str, list[float]] | None:
        """The best placement, as poses x, y, z, w, x, y, z: base in the current base frame, and TCP in the
        flange's frame. None if there is no finite value, if no placement reaches a target, or if the study
        uses samples, which are not placements.
        """
        values = np.asarray(columns.get(self.measure, ()), dtype=float)
        if not np.isfinite(values).any() or _reaches_nothing(columns) or (self.samples or 1) > 1:
            return None
        best = self.best_of(values)
        at = {name: columns[name][best].item() for name in self.axes}
        present = Pose.from_numbers(self.description.model.tcp_in_flange(self.robot.carried()))
        return {"base": list(_base_of(at).numbers), "tcp": list((present @ _tip_of(at)).numbers)}

    def contents(self) -> dict[str, str]:
        return super().contents() | ({} if self.targets is None else self.targets.contents())

    def kernel(self) -> Kernel:
        return _PlacementKernel.of(self, self.description)


@dataclass(frozen=True, slots=True)
class _Surroundings:
    """The solids that belong to the world in the model file, such as a floor.

    Attributes:
        numbers: numbers of the solids in MuJoCo's model.
        poses: poses of the solids in the world.
        world: pose of the world in the base frame.
    """

    robot: RobotDescription
    numbers: list[int]
    poses: list[Pose]
    world: Pose

    @classmethod
    def of(cls, robot: RobotDescription) -> Self:
        """Find the solids of a robot's model.

        Raises:
            NotSupportedError: a solid cannot be moved.
        """
        mj, spec = robot.model.mj, robot.model.spec
        numbers = np.flatnonzero(mj.geom_bodyid == 0).tolist()
        for number in numbers:
            geom = None if spec is None else spec.worldbody.geoms[number]
            is_mesh = mj.geom_type[number] == mujoco.mjtGeom.mjGEOM_MESH
            if geom is None or is_mesh or np.isfinite(geom.fromto[0]):
                name = mj.geom(number).name or f"geom {number}"
                raise NotSupportedError(
                    f"robot.settings: {name!r} of the model's world is a mesh or has fromto, and cannot be "
                    "moved; remove it from the model, and add it to robot.objects"
                )
        poses = [Pose(mj.geom_pos[number], mj.geom_quat[number]) for number in numbers]
        return cls(robot, numbers, poses, robot.model.fixed_frames["world"])

    def move(self, back: Pose) -> None:
        """Move the solids to their poses relative to a new base. `surround` then uses these poses.

        Args:
            back: pose of the current base in the frame of the new base.
        """
        spec = self.robot.model.spec
        shift = self.world.inverse() @ back @ self.world
        for number, pose in zip(self.numbers, self.poses, strict=True):
            assert spec is not None
            moved, geom = shift @ pose, spec.worldbody.geoms[number]
            self.robot.model.mj.geom_pos[number] = geom.pos = moved.position
            self.robot.model.mj.geom_quat[number] = geom.quat = moved.quaternion
            self.robot.model.mj.geom_sameframe[number] = 0  # otherwise MuJoCo would use the world's frame
            geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


@dataclass(slots=True)
class _PlacementKernel:
    """Evaluates placements one at a time, by moving the same robot."""

    study: PlacementStudy
    robot: RobotDescription
    scene: Scene
    tool: Tool
    fixed: _Surroundings
    reach: ReachKernel | None
    targets: Array

    @classmethod
    def of(cls, study: PlacementStudy, robot: RobotDescription) -> Self:
        """Create the kernel of a study.

        Raises:
            CobotError: the study contradicts the robot.
        """
        scene, tool, fixed = robot.collision.scene, study.robot.carried(), _Surroundings.of(robot)
        if study.targets is None:
            if study.program is not None:
                plan_program(robot, study.program[:1], 1.0, study.seed)
            return cls(study, robot, scene, tool, fixed, None, np.zeros((0, 0, 7)))
        places = places_of(study.targets)
        reach = ReachKernel(robot, places, study.approach, study.spins, study.method, None, study.seed)
        targets = np.array([reach.poses(number) for number in range(len(places.positions))])
        none = Places(np.zeros((0, 3)), None)
        return cls(study, robot, scene, tool, fixed, replace(reach, places=none), targets)

    def __call__(self, first: int, last: int) -> Columns:
        tool = self.robot.model.tool
        try:
            rows = [self._evaluate(self.study.at(task)) for task in range(first, last)]
        finally:
            self.robot.model.carry(tool, self.scene)
            self.fixed.move(Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])))
            self.robot.collision.surround(self.scene, tool)
        results = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        return {**self.study.parameters(first, last), **results}

    def _evaluate(self, values: dict[str, Value]) -> dict[str, float | str]:
        base = _base_of(values)
        self._place(base, _tip_of(values))
        found: dict[str, float | str] = {}
        if self.reach is not None:
            found |= self._reach(self.reach, base)
        if self.study.program is not None:
            found["duration_s"], found["planned"], found["cause"] = self._duration(self.study.program, base)
        return found

    def _place(self, base: Pose, tip: Pose) -> None:
        """Place the base of the arm in the scene, by moving the objects instead of the arm, and set the
        tool's TCP.
        """
        back = base.inverse()
        objects = {
            name: each if each.attached else replace(each, pose=(back @ Pose.from_numbers(each.pose)).numbers)
            for name, each in self.scene.objects.items()
        }
        model = self.robot.model
        tcp = Pose.from_numbers(model.tcp_in_flange(self.tool)) @ tip
        tool = replace(self.tool, version=1, tcp=tcp.numbers)
        scene = replace(self.scene, objects=objects)
        model.carry(tool, scene)
        self.fixed.move(back)
        self.robot.collision.surround(scene, tool)

    def _reach(self, reach: ReachKernel, base: Pose) -> dict[str, float]:
        back = base.inverse()
        turn = Rotation.from_quat(back.quaternion, scalar_first=True)
        found = []
        for number, poses in enumerate(self.targets):
            turns = (turn * Rotation.from_quat(poses[:, 3:], scalar_first=True)).as_quat(scalar_first=True)
            found.append(reach.evaluate(np.column_stack([back.apply(poses[:, :3]), turns]), number))
        manipulability = np.nan_to_num(np.array([each.manipulability for each in found]))
        return {
            "share": float(np.mean([each.share for each in found])),
            "manipulability": float(manipulability.mean()),
            "gap_m": float(np.mean([each.gap_m for each in found])),
        }

    def _duration(self, program: list[StudyMove], base: Pose) -> tuple[float, int, str]:
        """The program's duration (s) and the number of planned motions. If a motion cannot be planned, the
        duration is NaN, and the text gives the reason.
        """
        back = base.inverse()
        moved = [
            move
            if move.pose is None
            else move.model_copy(update={"pose": list((back @ Pose.from_numbers(move.pose)).numbers)})
            for move in program
        ]
        duration_s, planned = 0.0, 0
        try:
            for move in plan_moves(self.robot, moved, 1.0, self.study.seed):
                duration_s += 0.0 if move.trajectory is None else move.trajectory.duration_s
                planned += 1
        except (PlanningError, LimitError) as exc:
            return float("nan"), planned, str(exc)[:200]
        return duration_s, planned, ""


def _reaches_nothing(columns: Columns) -> bool:
    """Whether there are targets but no placement reaches any of them."""
    return "share" in columns and not np.asarray(columns["share"], dtype=float).any()


def _base_of(values: dict[str, Value]) -> Pose:
    """The new base in the current base frame."""
    return _pose(values, "base", "yaw", [0.0, 0.0, 1.0])


def _tip_of(values: dict[str, Value]) -> Pose:
    """The new TCP in the current TCP's frame."""
    return _pose(values, "tcp", "pitch", [0.0, 1.0, 0.0])


def _pose(values: dict[str, Value], what: str, angle: str, axis: list[float]) -> Pose:
    numbers = {name: values.get(f"{what}_{name}", 0.0) for name in ("x_m", "y_m", "z_m", f"{angle}_rad")}
    if any(isinstance(value, str) for value in numbers.values()):
        raise InputError(f"space: the parameters {what}_... must be numbers")
    position = np.array([float(numbers[name]) for name in ("x_m", "y_m", "z_m")])
    turn = Rotation.from_rotvec(float(numbers[f"{angle}_rad"]) * np.array(axis))
    return Pose(position, turn.as_quat(scalar_first=True))
