"""Reasons why an arm controlled by ros2_control cannot be moved, as sentences with advice."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cobot.foreign import joined_text, listed
from cobot.types import Array
from rtloop.backends.ros2_control.link import Facts, GoalFacts

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
ERRORS = {
    -1: "INVALID_GOAL: the controller finds the goal invalid",
    -2: "INVALID_JOINTS: the controller has other joints",
    -3: "OLD_HEADER_TIMESTAMP: the controller finds the goal too old",
    -4: "PATH_TOLERANCE_VIOLATED: the arm has left its path further than the controller permits",
    -5: "GOAL_TOLERANCE_VIOLATED: the arm has not arrived within the controller's tolerances",
    -6: "TRAJECTORY_ABORTED: the controller has aborted the motion",
}
"""Texts for the values of `error_code` in control_msgs/action/FollowJointTrajectory."""
MOTOROS2 = 100_000
"""Factor of the standard `error_code` in MotoROS2's codes, whose lower five digits are MotoROS2's own
code.
"""
BEYOND_RAD = 0.2
"""Maximum distance of a joint beyond its limit, rad. If it is larger, the reported position must be wrong."""
DISAGREE_RAD = 0.1
"""Maximum difference between recent positions in the joint states and those reported by the controller,
rad.
"""
FRESH_S = 0.1
"""Maximum age of positions that are compared, s."""
AS_IF = "check whether they are in degrees or in another order; robot.backend.joints defines the order"


@dataclass(frozen=True, slots=True)
class Expectation:
    """What the joint states must contain to be usable.

    Attributes:
        topic: topic of the joint states.
        names: joint names in ROS, in the arm's order.
        low, high: joint limits, shape (dof,), rad.
        measured: quantities that joint states contain besides positions.
        timeout_s, min_rate_hz: see the options.
    """

    topic: str
    names: list[str]
    low: Array
    high: Array
    measured: tuple[str, ...]
    timeout_s: float
    min_rate_hz: float


@dataclass(frozen=True, slots=True)
class CommandWords:
    """The nouns that messages use for one way of commanding the arm.

    Attributes:
        kind: name for the kind of controller.
        end: name for the other end of the connection.
        ends: the plural of `end`.
    """

    kind: str
    end: str
    ends: str


GOALS = CommandWords("joint trajectory controller", "server for the action", "actions")
COMMANDS = CommandWords("forward position controller", "subscriber of the topic", "topics")


def of_connection(facts: Facts, namespace: str, way: CommandWords = GOALS) -> str:
    """Return the reason why the arm cannot be commanded; "" if it can."""
    if facts.problem:
        return facts.problem
    where = f"in the namespace {namespace}" if namespace else "in the root namespace"
    if facts.choices:
        return (
            f"several {way.ends} fit the settings: {listed(facts.choices)}; name the controller in "
            "robot.backend.controller"
        )
    state = next((each for each in facts.controllers or () if each["name"] == facts.controller), None)
    if state is not None and state["state"] != "active":
        return (
            f"the controller {facts.controller} is {state['state']}: activate it with "
            f"`ros2 control switch_controllers --activate {facts.controller}`, then reset"
        )
    if facts.ready:
        return ""
    if facts.action:
        return (
            f"there is no {way.end} {facts.action}: start the driver, and compare ROS_DOMAIN_ID "
            "with ros.domain_id and ROS_LOCALHOST_ONLY with ros.localhost_only"
        )
    known = listed([f"{each['name']} ({each['state']})" for each in facts.controllers or ()])
    if known:
        return f"no {way.kind} {where} moves the arm's joints; controllers: {known}"
    return (
        f"there is no {way.kind} {where}: start the driver, and compare ROS_DOMAIN_ID with "
        "ros.domain_id and robot.backend.namespace with `ros2 topic list`"
    )


def of_joints_of_controller(facts: Facts, names: list[str]) -> str:
    """Return the reason why the controller does not match the arm; "" if it does, or if its joints are
    unknown.
    """
    state = next((each for each in facts.controllers or () if each["name"] == facts.controller), None)
    joints = set(state["joints"]) if state else set()
    if not joints or joints == set(names):
        return ""
    more, less = sorted(joints - set(names)), sorted(set(names) - joints)
    parts = [f"moves {listed(more)}, which the arm's model does not have"] if more else []
    parts += [f"does not move {listed(less)}"] if less else []
    return (
        f"the controller {facts.controller} {' and '.join(parts)}; a goal must have exactly its joints: "
        "correct the model, or robot.backend.joints and robot.backend.prefix"
    )


def of_joint_states(facts: Facts, expected: Expectation) -> str:
    """Return the reason why the joint states cannot be used; "" if they can."""
    topic, names = expected.topic, expected.names
    if facts.missing:
        return (
            f"{topic} has no joint {facts.missing[0]}: it has {listed(facts.names) or 'none'}; correct "
            "robot.backend.joints or robot.backend.prefix"
        )
    if facts.age_s is None:
        return (
            f"no joint state has arrived on {topic}: check that the joint_state_broadcaster is active, and "
            f"compare with `ros2 topic hz {topic}`"
        )
    if facts.age_s > expected.timeout_s:
        return silence_of(topic, facts.age_s, expected.timeout_s)
    if 0.0 < facts.rate_hz < expected.min_rate_hz:
        return (
            f"the rate of {topic} is {facts.rate_hz:.1f} Hz; the minimum is {expected.min_rate_hz:g} Hz "
            "(robot.backend.min_rate_hz): raise the publishing rate of the driver"
        )
    for row in ("position", *expected.measured):
        values = getattr(facts, row)
        if values is None:
            return f"{topic} has no {row}: remove it from robot.backend.measured"
        for name, value in zip(names, values, strict=True):
            if not math.isfinite(value):
                return f"{topic}: the {row} of {name} is {value}, not a number"
    position = np.array(facts.position)
    beyond = np.maximum(expected.low - position, position - expected.high)
    joint = int(np.nanargmax(beyond))
    if beyond[joint] > BEYOND_RAD:
        return (
            f"{topic}: {names[joint]} is at {position[joint]:.3f} rad, but its limits are "
            f"{expected.low[joint]:.3f} to {expected.high[joint]:.3f} rad: {AS_IF}"
        )
    return ""


def silence_of(topic: str, age_s: float, timeout_s: float) -> str:
    """Return the error message for joint states that have stopped arriving."""
    return (
        f"the last joint state on {topic} is {age_s:.2f} s old; the maximum is {timeout_s:g} s "
        "(robot.backend.state_timeout_s): check that the driver still runs"
    )


def of_goal(goal: GoalFacts, action: str) -> str:
    """Return the reason why the goal has failed; "" if it is running, has succeeded or was stopped."""
    if goal.accepted is False:
        return f"{action} has rejected the goal; the log of its driver has the reason"
    if goal.lost:
        return f"the driver of {action} has gone away or was restarted during the motion"
    if goal.status is None or goal.status == SUCCEEDED or goal.stopping:
        return ""
    text = joined_text(goal.error_string, 300)
    said = _error(goal.error_code) + (f" ({text})" if text else "")
    if goal.status == CANCELED:
        return f"another client has replaced or cancelled the goal of {action}: {said}"
    if goal.status == ABORTED:
        return f"{action} has aborted the motion: {said}"
    return f"{action} does not know the goal (status {goal.status}): the driver was restarted"


def disagreement(facts: Facts, names: list[str], topic: str) -> str:
    """Describe a difference between the joint states and the positions that the controller itself reports.
    Returns "" if they agree, or if either is too old for a comparison.
    """
    are_fresh = facts.held_age_s <= FRESH_S and facts.age_s is not None and facts.age_s <= FRESH_S
    if not are_fresh or facts.position is None:
        return ""
    (low, high), (held_low, held_high) = np.array(facts.position_range), np.array(facts.held_range)
    apart = np.maximum(low - held_high, held_low - high)
    joint = int(np.argmax(apart))
    if not apart[joint] > DISAGREE_RAD:
        return ""
    return (
        f"{topic} has {names[joint]} at {facts.position[joint]:.3f} rad, but its controller has it at "
        f"{facts.held[joint]:.3f} rad: {AS_IF}"
    )


def _error(code: int) -> str:
    if code <= -MOTOROS2:
        kind, own = divmod(-code, MOTOROS2)
        return f"{ERRORS.get(-kind, f'error {-kind}')}, code {own} of MotoROS2's MotionReadyEnum"
    return ERRORS.get(code, f"error_code {code}" if code else "without an error code")
