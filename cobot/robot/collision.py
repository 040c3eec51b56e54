"""Collision checks of the arm with itself and with its surroundings. They are based on exact distances and
can check whole motions.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np

from cobot.errors import CollisionError, InputError
from cobot.findings import Finding
from cobot.polynomials import control_points
from cobot.robot.clearance import Clearance
from cobot.robot.model import RobotModel
from cobot.robot.nearest import NearestParts
from cobot.robot.scene import Scene, clouds_in
from cobot.robot.tool import BARE, Tool
from cobot.trajectory import Trajectory
from cobot.types import Array

RESOLUTION_M = 5e-4
"""Accuracy of the check, m. A motion that passes it stays at least the margin minus this distance away from
everything.
"""

MAX_TRAVEL_RAD = 20_000.0
"""Maximum length of a motion that is checked; the check takes some seconds. A longer motion is a mistake."""
DEEPEST_SAMPLES = 300
"""Number of samples that locate the deepest contact of a rejected motion. Only the error message uses
them.
"""


@dataclass(frozen=True, slots=True)
class Contact:
    """Two bodies closer than the margin; `distance_m` is negative if they overlap."""

    first: str
    second: str
    distance_m: float

    def __str__(self) -> str:
        return f"{self.first} and {self.second} at {1e3 * self.distance_m:.0f} mm"


@dataclass(frozen=True, slots=True)
class FirstContact:
    """The first contact of a motion.

    Attributes:
        free_s: time before which the motion is proven free of collisions, s.
        time_s: time of the contact, s.
    """

    free_s: float
    time_s: float
    contact: Contact


class CollisionChecker:
    """Checks configurations of one robot. Not thread safe, because all calls use one scratch memory.

    The model's own rules decide which pairs of geoms may touch: contact types and affinities, excluded pairs,
    parent and child.

    Attributes:
        margin_m: a smaller distance is treated as a collision.
        clearance: computes the distances, and requires the margin.
        scene: the objects around the arm that are not in its model.
        tool: the tool on the flange, with its shapes.
    """

    def __init__(
        self, model: RobotModel, margin_m: float = 0.0, disabled: Iterable[frozenset[str]] = ()
    ) -> None:
        """
        Args:
            disabled: pairs of bodies, by name, that are never checked.
        """
        self.margin_m = margin_m
        self.limits = model.limits
        self.disabled: frozenset[frozenset[str]] = frozenset(disabled)
        self._model = model
        self.tool = BARE
        self.surround(Scene())

    def surround(self, scene: Scene, tool: Tool | None = None) -> None:
        """Change the scene around the arm, and the tool on its flange unless `tool` is None.

        Raises:
            InputError: MuJoCo rejects the scene or the tool; nothing has changed.
        """
        tool = tool or self.tool
        mj = self._model.among(scene, tool, by_voxels=True)
        apart, clouds = self.disabled | tool.mounted(scene).may_touch(), clouds_in(mj, scene)
        cubes = {geom + 1 for geom in clouds}
        pairs = [
            pair
            for pair in geom_pairs(mj)
            if cubes.isdisjoint(pair) and frozenset(body_or_geom(mj, geom) for geom in pair) not in apart
        ]
        self.clearance = Clearance(mj, pairs, RESOLUTION_M, clouds)
        self.clearance.require(self.margin_m)
        self._mj, self.scene, self.tool = mj, scene, tool
        self.pairs = list(self.clearance.pairs)
        self._nearest: NearestParts | None = None
        self._in_boxes: tuple[mujoco.MjModel, mujoco.MjModel] | None = None
        self._proven: Trajectory | None = None

    def take_over(self, other: CollisionChecker) -> None:
        """Copy the scene, the tool and the distances from another checker of the same arm, without computing
        them again.
        """
        self.clearance, self.pairs = other.clearance, other.pairs
        self._mj, self.scene, self.tool = other._mj, other.scene, other.tool
        self._nearest, self._in_boxes = None, other._in_boxes
        self._proven = None

    def among(self, scene: Scene, tool: Tool | None = None) -> CollisionChecker:
        """A checker of the same arm in a different scene or with a different tool. Raises the same errors as
        `surround`.
        """
        other = copy.copy(self)
        other.surround(scene, tool)
        return other

    def twin(self) -> CollisionChecker:
        """A checker of the same arm, scene and tool for use in another thread: it uses its own scratch
        memory.
        """
        other = copy.copy(self)
        other.clearance = Clearance(self._mj, self.pairs, RESOLUTION_M, self.clearance.clouds)
        other.clearance.require(self.margin_m)
        other._nearest = None
        return other

    @contextmanager
    def keeping(self, least_m: float | Array) -> Iterator[Clearance]:
        """Make the clearance require `least_m` instead of the margin until the context ends, and yield the
        clearance. `least_m` is one value for all pairs, or one per pair, m.
        """
        self.clearance.require(least_m)
        self._proven = None
        try:
            yield self.clearance
        finally:
            self.clearance.require(self.margin_m)
            self._proven = None

    def is_free(self, joints: Array) -> bool:
        """Whether all pairs of bodies keep the margin. Takes about 2 µs."""
        return self.clearance.is_free(joints)

    def contacts(self, joints: Array) -> list[Contact]:
        """All pairs of bodies that are closer to each other than the margin. The deepest contact is listed
        first.
        """
        distances = self.clearance.distances(np.asarray(joints)[None], max(self.margin_m, 0.0))[0]
        found: dict[tuple[str, str], float] = {}
        for index in np.flatnonzero(distances < self.margin_m):
            names = self.names(int(index))
            found[names] = min(found.get(names, np.inf), float(distances[index]))
        return sorted((Contact(*names, dist) for names, dist in found.items()), key=lambda c: c.distance_m)

    def names(self, pair: int) -> tuple[str, str]:
        """The names of the two bodies of a pair, for messages."""
        first, second = self.pairs[pair]
        return self.name(first), self.name(second)

    def are_own(self) -> list[bool]:
        """For each pair, whether both bodies belong to the robot. Bodies of the robot have the same root
        body.
        """
        root_of = self._mj.body_rootid[self._mj.geom_bodyid].tolist()
        stands = {name for name, each in self.scene.objects.items() if not each.attached}
        return [
            root_of[first] == root_of[second] != 0 and stands.isdisjoint(self.names(pair))
            for pair, (first, second) in enumerate(self.pairs)
        ]

    @property
    def nearest(self) -> NearestParts:
        """The object that finds the nearest parts."""
        if self._nearest is None:
            self._nearest = NearestParts(self, self._model.base)
        return self._nearest

    @property
    def mj(self) -> mujoco.MjModel:
        """MuJoCo's model with the scene's objects and the tool's shapes. An unattached point cloud is
        represented only by the box around all its voxels.
        """
        return self._mj

    @property
    def mj_in_boxes(self) -> mujoco.MjModel:
        """The same model with each point cloud as boxes, as streams check it. Used for pictures."""
        mj, known = self._mj, self._in_boxes
        if known is None or known[0] is not mj:  # a thread may draw the scene before this one
            has_clouds = bool(self.clearance.clouds)
            known = self._in_boxes = mj, self._model.among(self.scene, self.tool) if has_clouds else mj
        return known[1]

    @property
    def body_names(self) -> list[str]:
        """Names of the bodies of the model, its tool and the world, without the scene's objects."""
        geoms = range(self._model.mj.ngeom)
        names = [body_or_geom(self._model.mj, geom) for geom in geoms]
        return list(dict.fromkeys([*names, *self.tool.shapes]))

    def name(self, geom: int) -> str:
        """The name of a geom for messages: the name of its body, or the geom's own name if it is part of the
        world.
        """
        return body_or_geom(self._mj, geom)

    def check_trajectory(self, trajectory: Trajectory) -> None:
        """Reject a motion that brings the arm closer than the margin to any body or to itself.

        The check is a proof, not a sample: a motion that passes keeps at least the margin minus
            `RESOLUTION_M` at all times. The motion that passed last is not proven again.

        Raises:
            CollisionError: names the bodies, the time, the share of the motion, the joint angles, and the
                deepest contact.
            InputError: the motion is too long to be checked.
        """
        found = self.first_contact(trajectory)
        if found is not None:
            raise self.refusal(trajectory, found)

    def has_proven(self, trajectory: Trajectory) -> bool:
        """Whether a motion is the one that passed `check_trajectory` last."""
        last = self._proven
        return last is not None and (
            trajectory.coefficients is last.coefficients and trajectory.breakpoints_s is last.breakpoints_s
        )

    def first_contact(self, trajectory: Trajectory) -> FirstContact | None:
        """Find where a motion fails `check_trajectory`; None if it passes. The check is skipped for the
        motion that has passed last.

        Raises:
            InputError: see `check_trajectory`.
        """
        if self.has_proven(trajectory):
            return None
        pieces = motion_pieces(trajectory)
        travel = float(np.abs(np.diff(pieces, axis=1)).sum(axis=1).max(axis=1).sum())
        if not travel <= MAX_TRAVEL_RAD:
            raise InputError(
                f"the motion travels {travel:.4g} {self.limits.units}, but only {MAX_TRAVEL_RAD:g} "
                f"{self.limits.units} can be checked for collisions"
            )
        found = self.clearance.contact(pieces)
        if found is None:
            self._proven = trajectory
            return None
        first = self.clearance.contact(pieces, first=True)  # may prove a distance within the resolution
        piece, share, pair, distance_m = first or found
        begin_s, end_s = trajectory.breakpoints_s[piece : piece + 2]
        time_s = float(begin_s + share * (end_s - begin_s))
        return FirstContact(0.0 if first is None else time_s, time_s, Contact(*self.names(pair), distance_m))

    def refusal(self, trajectory: Trajectory, found: FirstContact) -> CollisionError:
        """The error of `check_trajectory` for a motion, which reports its first contact and its deepest
        contact.
        """
        time_s, contact = found.time_s, found.contact
        joints = trajectory.sample([time_s])[0]
        times = np.linspace(0.0, trajectory.duration_s, DEEPEST_SAMPLES)
        distances = self.clearance.distances(trajectory.sample(times), max(self.margin_m, 0.0))
        row, pair = np.unravel_index(int(distances.argmin()), distances.shape)
        deepest = Contact(*self.names(int(pair)), float(distances[row, pair]))
        percent = 100.0 / trajectory.duration_s
        return CollisionError(
            f"collision of {contact} after {percent * time_s:.0f} % of the motion ({time_s:.2f} s), at "
            f"joints {_shown(joints)} {self.limits.units}; the deepest contact is {deepest} after "
            f"{percent * times[row]:.0f} %; allowed: {1e3 * self.margin_m:.0f} mm",
            findings=[
                self.finding(contact, time_s / trajectory.duration_s),
                self.finding(deepest, float(times[row]) / trajectory.duration_s),
            ],
        )

    def check_position(self, joints: Array, what: str, share: float | None = None) -> None:
        """Reject a configuration that is in collision.

        Args:
            share: position of the configuration in a motion: 0 at the start, 1 at the goal.

        Raises:
            CollisionError: the configuration is in collision; the message names `what` and the bodies.
        """
        if self.is_free(joints):
            return
        if contacts := self.contacts(joints):
            raise CollisionError(
                f"{what} is in collision: {contacts[0]}, at joints {_shown(joints)} {self.limits.units}",
                findings=[self.finding(contact, share) for contact in contacts],
            )

    def finding(self, contact: Contact, share: float | None) -> Finding:
        """A contact as a finding about a motion."""
        pair = contact.first, contact.second
        return Finding("collision", "distance", contact.distance_m, self.margin_m, "m", share, pair)


def body_or_geom(mj: mujoco.MjModel, geom: int) -> str:
    body = int(mj.geom_bodyid[geom])
    return str(mj.body(body).name) if body else str(mj.geom(geom).name or "the surroundings")


def motion_pieces(trajectory: Trajectory) -> Array:
    """A motion as Bezier curves for `Clearance.contact`: control points, shape (n, 6, dof), rad."""
    return control_points(trajectory.coefficients, np.diff(trajectory.breakpoints_s))


def _shown(joints: Array) -> str:
    return "[" + ", ".join(f"{value:.3f}" for value in joints) + "]"


def geom_pairs(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """The pairs of geoms that can collide in MuJoCo: its filter includes them, or a <pair> names them."""
    excluded = {tuple(sorted((int(s) >> 16, int(s) & 0xFFFF))) for s in model.exclude_signature}
    body_of = model.geom_bodyid.tolist()
    weld_of = model.body_weldid[model.geom_bodyid].tolist()
    parent_of = model.body_weldid[model.body_parentid[weld_of]].tolist()
    kind, partners = model.geom_contype.tolist(), model.geom_conaffinity.tolist()
    pairs = []
    for first in range(model.ngeom):
        for second in range(first + 1, model.ngeom):
            if not (kind[first] & partners[second] or kind[second] & partners[first]):
                continue
            welds = weld_of[first], weld_of[second]
            related = welds[0] == welds[1] or (
                0 not in welds and (welds[0] == parent_of[second] or welds[1] == parent_of[first])
            )
            if not related and tuple(sorted((body_of[first], body_of[second]))) not in excluded:
                pairs.append((first, second))
    named = np.sort(np.stack([model.pair_geom1, model.pair_geom2], axis=1), axis=1).tolist()
    pairs += [(first, second) for first, second in named if weld_of[first] != weld_of[second]]
    return list(dict.fromkeys(pairs))
