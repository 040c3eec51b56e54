"""The posture `home` of a new robot: the one in the file, or one that a person would choose.

A person leaves most joints at 0 and turns a few by multiples of 45°, so that the arm is above its base, easy
to hold and far from touching itself. Such postures are ranked by a cost.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations, product
from pathlib import Path

import mujoco
import numpy as np

from cobot.errors import CobotError, ConfigError
from cobot.robot.collision import CollisionChecker
from cobot.robot.holding import held
from cobot.robot.limits import check_positions
from cobot.robot.model import RobotModel
from cobot.types import Array

START_NAMES = ("home", "ready", "default")
"""Usual names of the state in which a robot starts, in order of preference."""
STEP_RAD, MAX_STEPS = np.pi / 4.0, 3
MAX_TURNED = 3
"""Maximum number of joints that are not at their reference position."""
ROOM_SHARE, MAX_ROOM = 0.02, 0.05
"""Distance from the limits, as a share of the range, and the maximum of this distance, rad or m."""
WIDE_MARGIN_M = 0.02
LISTED, LISTED_SHARE = 20, 0.5
"""Maximum number of pairs in a message, and the minimum share of random positions in which a listed pair
touches.
"""
HELD_SHARE = 0.9
COST_TURNED, COST_RIGHT_ANGLE = 1.0, 0.25
"""Cost of each joint that is not at its reference position, and cost of each 90° by which it is turned."""
COST_HOLDING = 8.0
"""Cost factor for holding the arm. It multiplies the greatest share of a joint's effort that holding
takes.
"""
COST_BELOW, COST_NARROW, COST_SINGULAR = 4.0, 1.0, 0.4
"""Cost of a link below the base, of links that are nearer than the wide margin, and of a singular posture."""
SINGULAR = 0.01
"""Ratio of the least to the greatest singular value of the Jacobian below which a posture is considered
singular. Lengths are shares of the reach.
"""
SAMPLES = 500
_SIZES = {mujoco.mjtJoint.mjJNT_FREE: 7, mujoco.mjtJoint.mjJNT_BALL: 4}


def start_name(names: Iterable[str]) -> str | None:
    """The name of the state in which the robot starts, found in the order of `START_NAMES`."""
    by_lower = {name.lower(): name for name in reversed(list(names))}
    return next((by_lower[each] for each in START_NAMES if each in by_lower), None)


def keyframe(spec: mujoco.MjSpec) -> dict[str, float] | None:
    """Joint positions of the start keyframe, by name. It is the keyframe with a name in `START_NAMES`, or the
    only keyframe.
    """
    keys = {key.name: key for key in spec.keys if len(key.qpos)}
    name = start_name(keys) or (next(iter(keys)) if len(keys) == 1 else None)
    if name is None:
        return None
    values: dict[str, float] = {}
    begin = 0
    for joint in spec.joints:
        if joint.type not in _SIZES and begin < len(keys[name].qpos):
            values[joint.name] = float(keys[name].qpos[begin])
        begin += _SIZES.get(joint.type, 1)
    return values


def positions(
    file: Path,
    robot: RobotModel,
    collision: CollisionChecker,
    base: str,
    states: Mapping[str, Array],
    guessed: list[str],
) -> dict[str, Array]:
    """The states in the files that are possible for the robot. `home` is added if none of them is a start
    state.

    Raises:
        ConfigError: the arm touches itself in each posture that was tried.
    """
    found = {}
    for name, joints in states.items():
        if flaw := _flaw(robot, collision, joints):
            guessed.append(f"state {name!r} of the file is left out: {flaw}")
        else:
            found[name] = joints
            guessed.append(f"{name}: {np.round(joints, 3).tolist()}, as in the file")
    if start_name(found) is None:
        found["home"], why = _choose(file, robot, collision, base)
        guessed.append(f"home: {np.round(found['home'], 3).tolist()}, {why}")
    return found


def _flaw(robot: RobotModel, collision: CollisionChecker, joints: Array) -> str:
    """The reason why the robot cannot take a position; "" if it can."""
    try:
        check_positions(robot.limits, joints)
    except CobotError as exc:
        return str(exc)
    if contacts := collision.contacts(joints):
        return f"{contacts[0].first} touches {contacts[0].second}"
    hold = held(robot, robot.limits, joints)
    return str(hold) if hold.share > 1.0 else ""


def _choose(file: Path, robot: RobotModel, collision: CollisionChecker, base: str) -> tuple[Array, str]:
    """The chosen posture, and a sentence that explains how it was found."""
    choice = _Choice(robot, collision, base)
    best, least = None, float("inf")
    for own_cost, joints in choice.candidates():
        if own_cost >= least:
            break
        if (cost := own_cost + choice.cost(joints)) < least:
            best, least = joints, cost
    if best is not None:
        share = held(robot, robot.limits, best).share
        return best, f"joints at multiples of 45°; holding it takes {100.0 * share:.0f} % of a drive"
    best, touching = choice.nearest_free(), choice.touches_most()
    way_out = (
        "if these links may touch, disable the pairs in an SRDF (--srdf); otherwise correct their shapes"
    )
    if best is None:
        raise ConfigError(
            f"{file}: the arm touches itself in each of {SAMPLES} positions, {touching}; {way_out}"
        )
    why = "the free position nearest to 0; no posture with simple angles is free and can be held"
    return best, why + (f"; of {SAMPLES} positions, these touch: {touching}; {way_out}" if touching else "")


class _Choice:
    def __init__(self, robot: RobotModel, collision: CollisionChecker, base: str) -> None:
        self._robot, self._collision, self._limits = robot, collision, robot.limits
        self._data = mujoco.MjData(robot.mj)
        self._base = robot.mj.body(base).id
        self._moving = np.flatnonzero(robot.mj.body_weldid != 0)
        self._reach = max(float(np.linalg.norm(robot.mj.body_pos[self._moving], axis=1).sum()), 1e-3)
        self._options = [self._values(index) for index in range(robot.dof)]

    def _values(self, index: int) -> list[float]:
        """The values that a person might choose for a joint. The value nearest to the joint's reference is
        listed first.
        """
        low, high = float(self._limits.min_position[index]), float(self._limits.max_position[index])
        room = min(MAX_ROOM, ROOM_SHARE * (high - low))
        reference = float(self._robot.mj.qpos0[index])
        if self._limits.slides and self._limits.slides[index]:
            return [reference if low <= reference <= high else 0.5 * (low + high)]
        steps = [count * STEP_RAD for count in range(-MAX_STEPS, MAX_STEPS + 1)]
        inside = [value for value in {reference, *steps} if low + room <= value <= high - room]
        return sorted(inside, key=lambda value: (abs(value - reference), value)) or [0.5 * (low + high)]

    def candidates(self) -> Iterator[tuple[float, Array]]:
        """Postures with the cost of their angles, cheapest first."""
        reference = np.array([options[0] for options in self._options])
        found = []
        for count in range(min(MAX_TURNED, self._robot.dof) + 1):
            for turned in combinations(range(self._robot.dof), count):
                for values in product(*(self._options[index][1:] for index in turned)):
                    joints = reference.copy()
                    joints[list(turned)] = values
                    angles = float(np.abs(joints - reference).sum()) / (np.pi / 2.0)
                    found.append((COST_TURNED * count + COST_RIGHT_ANGLE * angles, joints))
        return iter(sorted(found, key=lambda each: each[0]))

    def cost(self, joints: Array) -> float:
        """The cost of a posture; infinite if it is in collision or cannot be held easily."""
        if not self._collision.is_free(joints):
            return float("inf")
        share = held(self._robot, self._limits, joints).share
        if share > HELD_SHARE:
            return float("inf")
        cost = COST_HOLDING * share
        cost += COST_BELOW * self._is_below_base(joints) + COST_SINGULAR * self._is_singular(joints)
        with self._collision.keeping(WIDE_MARGIN_M) as clearance:
            return cost + COST_NARROW * (not clearance.is_free(joints))

    def _is_below_base(self, joints: Array) -> bool:
        """Whether a link of an upright arm is below the base."""
        self._data.qpos[:] = joints
        mujoco.mj_kinematics(self._robot.mj, self._data)
        up = self._data.xmat[self._base].reshape(3, 3)[:, 2]
        gravity = self._robot.mj.opt.gravity
        heights = (self._data.xpos[self._moving] - self._data.xpos[self._base]) @ up
        return bool(up @ gravity < -0.9 * np.linalg.norm(gravity) < 0.0 and heights.min() < -0.01)

    def _is_singular(self, joints: Array) -> bool:
        jacobian = self._robot.jacobian(joints)
        jacobian[:3] /= self._reach
        values = np.linalg.svd(jacobian, compute_uv=False)
        return bool(values[-1] < SINGULAR * values[0])

    def nearest_free(self) -> Array | None:
        """The collision-free random position nearest to 0, preferably one that the drives can hold."""
        limits, rows = self._limits, self._random()
        zero = np.clip(self._robot.mj.qpos0, limits.min_position, limits.max_position)
        free = [joints for joints in (zero, *rows) if self._collision.is_free(joints)]
        holds = [joints for joints in free if held(self._robot, limits, joints).share <= 1.0]
        return min(holds or free, key=lambda joints: float(np.abs(joints - zero).max()), default=None)

    def touches_most(self) -> str:
        """The pairs that touch in many of the random positions, or else the pair that touches most often; ""
        if no pair touches in any position.
        """
        pairs: Counter[tuple[str, str]] = Counter()
        for joints in self._random():
            pairs.update({(each.first, each.second) for each in self._collision.contacts(joints)})
        most = [each for each in pairs.most_common(LISTED) if each[1] >= LISTED_SHARE * SAMPLES]
        return ", ".join(
            f"{first} and {second} in {count} of them"
            for (first, second), count in most or pairs.most_common(1)
        )

    def _random(self) -> Array:
        low, high = self._limits.min_position, self._limits.max_position
        return np.random.default_rng(0).uniform(low, high, (SAMPLES, len(low)))
