"""Telescopes: linear joints along one axis, of which one leads and the others follow. They are combined into
one joint.

The first stage leads with the travel q, and the others follow with a_i + m_i q. The last one then travels S
q, with S = 1 + |m_1| + |m_2| + ... In the model, a single joint travels S q, and all stages move with it. So
the TCP poses are exact, and the load of the drive is never underestimated.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from cobot.launch.robot_file.joints import orientation, place
from cobot.launch.robot_file.mjcf import has_bounds
from cobot.launch.robot_file.tree import MovingJoint
from cobot.robot.quaternion import rotated
from cobot.types import Array, vector

PARALLEL = 1e-9
"""Axes are parallel if the cosine between them differs from 1 by less than this."""


@dataclass(frozen=True, slots=True)
class Telescope:
    """A linear joint, and the linear joints that follow it along the same axis.

    Attributes:
        first: the joint that leads, nearest to the base.
        others: the joints that follow it, in the order of the chain.
        lines: for each of `others`: its position relative to its reference while the first joint is at 0, and
            its travel for each metre of the first joint.
    """

    first: MovingJoint
    others: tuple[MovingJoint, ...]
    lines: tuple[tuple[float, float], ...]

    @property
    def travel(self) -> float:
        """Travel of the last stage for each metre of the first."""
        return 1.0 + sum(abs(slope) for _, slope in self.lines)

    def merge(self, spec: mujoco.MjSpec, rates: dict[str, tuple[float, float]]) -> str:
        """Combine the telescope into one joint, which gets the name of the first.

        Args:
            rates: the joints' velocity and effort limits; 0 if unknown. The entry of the first joint is
                changed.

        Returns:
            A sentence about the change, for the user.
        """
        joint, travel = self.first.joint, self.travel
        rates[self.first.name] = self._velocity_and_effort(rates)
        ranges = self._ranges()
        if ranges:
            joint.range = travel * np.array(
                [max(lower for lower, _ in ranges), min(upper for _, upper in ranges)]
            )
        for node, (_, slope) in zip(self.others, self.lines, strict=True):
            joint.frictionloss += node.joint.frictionloss * abs(slope)
            joint.damping = joint.damping + node.joint.damping * slope**2
            joint.armature += node.joint.armature * slope**2
        joint.ref *= travel
        joint.frictionloss /= travel
        joint.damping = joint.damping / travel**2
        joint.armature /= travel**2
        joint.actfrcrange = joint.actfrcrange / travel
        starts = (node.joint.ref + start for node, (start, _) in zip(self.others, self.lines, strict=True))
        place(spec, dict(zip(self.others, starts, strict=True)))
        names = [node.name for node in self.others]
        for equality in [each for each in spec.equalities if {each.name1, each.name2} & set(names)]:
            spec.delete(equality)
        for node in self.others:
            spec.delete(node.joint)
        stages = (self.first, *self.others)
        self.first.children = [each for node in stages for each in node.children if each not in stages]
        for child in self.first.children:
            child.parent = self.first
        return (
            f"telescope found: {self.first.name} also moves {', '.join(names)}. In the model they are "
            f"one joint. Its position is the travel of the last stage: {travel:g} times that of "
            f"{self.first.name} in the file. All stages move with the last one, so collisions with the "
            "middle stages of an extended telescope are not found"
        )

    def rescale(self, states: Iterable[dict[str, float]]) -> None:
        """Convert the states in the file: the value of the joint becomes the travel of the last stage."""
        for state in states:
            if self.first.name in state:
                state[self.first.name] *= self.travel

    def _velocity_and_effort(self, rates: dict[str, tuple[float, float]]) -> tuple[float, float]:
        """Maximum velocity and maximum effort of the last stage. At this velocity, no joint exceeds its own
        limit.
        """
        velocity, effort = rates.get(self.first.name, (0.0, 0.0))
        velocities = [velocity] if velocity else []
        for node, (_, slope) in zip(self.others, self.lines, strict=True):
            if own := rates.get(node.name, (0.0, 0.0))[0]:
                velocities.append(own / abs(slope))
        return min(velocities, default=0.0) * self.travel, effort / self.travel

    def _ranges(self) -> list[tuple[float, float]]:
        """Ranges for the first joint, one from each joint that has limits."""
        joint = self.first.joint
        found = [tuple(joint.range)] if has_bounds(joint.limited, joint.range) else []
        for node, (start, slope) in zip(self.others, self.lines, strict=True):
            if has_bounds(node.joint.limited, node.joint.range):
                ends = (node.joint.range - node.joint.ref - start) / slope + joint.ref
                found.append((min(ends), max(ends)))
        return found


def find_telescopes(spec: mujoco.MjSpec, chain: Sequence[MovingJoint]) -> list[Telescope]:
    """The telescopes in a chain of joints. The joints of a telescope directly follow each other in the chain,
    and all move with the first one.
    """
    found = []
    for index, node in enumerate(chain):
        lines = {} if node.leader else {node.name: (0.0, 1.0)}
        stages = [node]
        for other in chain[index + 1 :]:
            if other.parent is not stages[-1] or (line := _line(spec, node, other, lines)) is None:
                break
            lines[other.name] = line
            stages.append(other)
        if len(stages) > 1:
            found.append(Telescope(node, tuple(stages[1:]), tuple(lines.values())[1:]))
    return found


def _line(
    spec: mujoco.MjSpec, first: MovingJoint, other: MovingJoint, lines: dict[str, tuple[float, float]]
) -> tuple[float, float] | None:
    """Start and slope of a joint that follows the first joint along its axis and in its direction; None for
    any other joint.
    """
    both_slide = first.joint.type == other.joint.type == mujoco.mjtJoint.mjJNT_SLIDE
    if not both_slide or other.leader not in lines or any(other.polynomial[2:]):
        return None
    start, slope = other.polynomial[:2]
    leader_start, leader_slope = lines[other.leader]
    start, slope = start + slope * leader_start, slope * leader_slope
    along = float(_unit(first) @ _seen_from(spec, first, other))
    return (start, slope) if abs(along) > 1.0 - PARALLEL and slope * along > 0.0 else None


def _unit(node: MovingJoint) -> Array:
    axis = vector(node.joint.axis)
    return axis * (1.0 / float(np.linalg.norm(axis)))


def _seen_from(spec: mujoco.MjSpec, first: MovingJoint, other: MovingJoint) -> Array:
    """The axis of a joint, in the frame of the link of `other`."""
    axis, body = _unit(other), other.joint.parent
    while body.name != first.joint.parent.name:
        axis = np.array(rotated(orientation(spec, body), axis.tolist()))
        body = body.parent
    return axis
