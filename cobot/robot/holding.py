"""Checks that the drives can hold the arm, in one posture or in all: they compare gravity torques with
max_effort.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cobot.cell.surroundings import scene_file, tool_file
from cobot.config import Settings
from cobot.errors import LimitError
from cobot.findings import Finding
from cobot.robot.collision import CollisionChecker
from cobot.robot.description import RobotDescription
from cobot.robot.dynamics import Dynamics
from cobot.robot.model import RobotModel
from cobot.robot.tool import BARE, Tool
from cobot.types import Array, JointLimits, vector

SAMPLES = 2000
"""Number of random postures. The search for the posture that is hardest to hold starts from the hardest of
them.
"""
STARTS, ROUNDS, STEPS = 2, 4, 15
"""Number of the hardest postures that are improved, number of rounds, and number of values that are tried for
each joint in a round.
"""
PAYLOAD_SHARE = 0.9
"""Share of an effort limit that holding the payload may take. The rest is for moving the payload."""
TOLERANCE = 1e-6
DECIMALS = 9
"""Decimals of a demand at which two postures are equally hard."""

Demand = Callable[[Array], Array]
"""Computes a number for each posture, shape (n, dof); a higher number means harder to hold."""


@dataclass(frozen=True, slots=True)
class HoldingEffort:
    """The effort that a joint needs to hold the arm in a posture, and its limit; N·m, or N for linear
    joints.
    """

    joint: str
    needed: float
    limit: float
    unit: str
    posture: Array

    @property
    def share(self) -> float:
        return self.needed / self.limit

    def __str__(self) -> str:
        return (
            f"{self.joint} needs {self.needed:.4g} {self.unit} to hold the arm, but its max_effort is "
            f"{self.limit:.4g} {self.unit}"
        )

    def placed(self) -> str:
        """The effort and the posture as text."""
        return f"at joints {np.round(self.posture, 2).tolist()} {self}"


def held(model: RobotModel, limits: JointLimits, joints: Array) -> HoldingEffort:
    """The joint that needs the greatest share of its effort limit to hold a posture. The model's load is
    included.
    """
    torques = np.abs(model.gravity_torques(joints))
    return _hold(model, limits, joints, int((torques / limits.max_effort).argmax()))


def check_start(robot: RobotDescription, settings: Settings) -> None:
    """Reject a start position in which the simulated drives cannot hold the arm with its tool.

    Raises:
        LimitError: see `check_holds`.
        ConfigError: the tool file is invalid.
    """
    if settings.robot.backend.type != "mujoco":
        return
    model, name = robot.model, settings.robot.start_position
    model.carry(_tool(robot, settings))
    try:
        what = f"{settings.robot.srdf}: position {name!r}"
        check_holds(model, robot.limits, vector(robot.positions[name].joints), what)
    finally:
        model.carry(BARE)


def attach_tool_and_objects(robot: RobotDescription, settings: Settings) -> None:
    """Add the tool and the attached objects to the model, as the service does when it starts.

    Raises:
        ConfigError: a file is invalid.
    """
    robot.model.carry(_tool(robot, settings), scene_file(settings).read())


def _tool(robot: RobotDescription, settings: Settings) -> Tool:
    return tool_file(settings).read_checked(settings.robot.max_payload_kg, robot.model.file_gravity)


def check_holds(model: RobotModel, limits: JointLimits, joints: Array, what: str) -> None:
    """Reject a posture that the drives cannot hold.

    Raises:
        LimitError: the drives cannot hold the posture; the message names `what`, the joint, the needed effort
            and the limit.
    """
    hold = held(model, limits, joints)
    if hold.share > 1.0 + TOLERANCE:
        load = f" with {model.carried.mass:g} kg" if model.carried.mass else ""
        raise LimitError(
            f"{what} cannot be held{load}: {hold}; choose another position, or correct max_effort or the "
            "masses",
            findings=[Finding("effort", "effort", hold.needed, hold.limit, hold.unit, None, (hold.joint,))],
        )


@dataclass(frozen=True, slots=True)
class Holding:
    """How well the drives can hold the arm in all its postures.

    Attributes:
        hardest: for each joint the posture that needs the greatest share of its effort limit, greatest share
            first.
        share: share of random collision-free postures that the drives can hold.
    """

    hardest: list[HoldingEffort]
    share: float

    @property
    def percent(self) -> str:
        """The share as text. It is below "100 %" if even one posture fails."""
        percent = 100.0 * self.share
        if percent > 99.0 and not self.everywhere:
            return "more than 99 %"
        return f"{percent:.0f} %" if percent >= 1.0 else "less than 1 %"

    @property
    def everywhere(self) -> bool:
        return self.hardest[0].share <= 1.0 + TOLERANCE

    @property
    def failing(self) -> list[HoldingEffort]:
        return [hold for hold in self.hardest if hold.share > 1.0 + TOLERANCE]


def examine(model: RobotModel, collision: CollisionChecker, limits: JointLimits) -> Holding:
    """Search the collision-free postures for those that are hardest to hold, with the load of the model."""
    postures = _free_postures(collision, limits)
    torques = _gravity(model.dynamics, postures)
    found = []
    for joint in range(limits.dof):

        def demand(rows: Array, joint: int = joint) -> Array:
            return np.asarray(np.abs(_gravity(model.dynamics, rows)[:, joint]))

        found.append(_hold(model, limits, _hardest(demand, postures, collision, limits), joint))
    holds = (np.abs(torques) <= limits.max_effort).all(axis=1)
    return Holding(sorted(found, key=lambda hold: -hold.share), float(holds.mean()))


def payload(
    model: RobotModel, collision: CollisionChecker, limits: JointLimits
) -> tuple[float, HoldingEffort]:
    """Find the largest payload, and the joint that limits it.

    Returns:
        The mass at the TCP, kg, that the drives hold in every posture with `PAYLOAD_SHARE` of their effort
        limits. It is infinite if no drive carries it, and 0 if the arm alone is too heavy. Second, the effort
        that the limiting joint needs in the hardest posture without this mass.
    """
    efforts, loaded = PAYLOAD_SHARE * limits.max_effort, _with_one_kg(model)

    def masses(rows: Array) -> Array:
        alone = _gravity(model.dynamics, rows)
        of_load = _gravity(loaded, rows) - alone
        room = efforts - np.sign(of_load) * alone
        with np.errstate(divide="ignore"):
            return np.asarray(np.where(np.abs(of_load) > 1e-9, room / np.abs(of_load), np.inf))

    def demand(rows: Array) -> Array:
        return np.asarray(-masses(rows).min(axis=1))

    posture = _hardest(demand, _free_postures(collision, limits), collision, limits)
    of_each = masses(posture[None])[0]
    joint = int(of_each.argmin())
    return max(float(of_each[joint]), 0.0), _hold(model, limits, posture, joint)


def _with_one_kg(model: RobotModel) -> Dynamics:
    """The dynamics with 1 kg at the TCP of the model file."""
    tool = model.tool
    model.carry(replace(tool, mass=1.0, centre=model.tcp_in_flange()[:3], inertia=None))
    try:
        return Dynamics(copy.copy(model.mj))
    finally:
        model.carry(tool)


def _hold(model: RobotModel, limits: JointLimits, posture: Array, joint: int) -> HoldingEffort:
    needed = float(abs(model.gravity_torques(posture)[joint]))
    limit = float(limits.max_effort[joint])
    return HoldingEffort(limits.names[joint], needed, limit, limits.effort_unit(joint), posture)


def _gravity(dynamics: Dynamics, rows: Array) -> Array:
    still = np.zeros_like(rows)
    return np.asarray(dynamics.inverse(rows, still, still))


def _free_postures(collision: CollisionChecker, limits: JointLimits) -> Array:
    """Random collision-free postures. If none is collision-free, all random postures are returned."""
    size = (SAMPLES, limits.dof)
    postures = np.random.default_rng(0).uniform(limits.min_position, limits.max_position, size)
    free = np.array([collision.is_free(joints) for joints in postures])
    return postures[free] if free.any() else postures


def _hardest(demand: Demand, postures: Array, collision: CollisionChecker, limits: JointLimits) -> Array:
    """Search for the hardest posture to hold, by coordinate ascent from the hardest of the given postures.

    Rounding errors differ between computers. Of equally hard postures, the first is taken on each of them.
    """

    def rounded(rows: Array) -> Array:
        return demand(rows).round(DECIMALS)

    order = np.argsort(-rounded(postures), kind="stable")[:STARTS]
    climbed = np.array([_maximise(rounded, postures[index], collision, limits) for index in order])
    return np.asarray(climbed[int(rounded(climbed).argmax())])


def _maximise(demand: Demand, posture: Array, collision: CollisionChecker, limits: JointLimits) -> Array:
    span, value = limits.max_position - limits.min_position, float(demand(posture[None])[0])
    for round_ in range(ROUNDS):
        for joint in range(limits.dof):
            rows = np.tile(posture, (STEPS, 1))
            around = posture[joint] + span[joint] / 4.0**round_ * np.linspace(-1.0, 1.0, STEPS)
            rows[:, joint] = np.clip(around, limits.min_position[joint], limits.max_position[joint])
            values = demand(rows)
            for index in np.argsort(-values, kind="stable"):
                if values[index] <= value + TOLERANCE * abs(value):
                    break
                if collision.is_free(rows[index]):
                    posture, value = rows[index], float(values[index])
                    break
    return posture
