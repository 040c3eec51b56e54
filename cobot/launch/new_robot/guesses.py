"""Guesses of `cobot new-robot` for values that are missing in a robot's file. Each guess is reported in a
sentence, so that the user checks it.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import yaml
from numpy.typing import NDArray

from cobot.errors import ConfigError
from cobot.launch.robot_file.meshes import LARGE_M
from cobot.launch.robot_file.typed import typed
from cobot.launch.robot_file.urdf import WORLD
from cobot.robot.collision import CollisionChecker
from cobot.robot.model import RobotModel
from cobot.types import Array, JointLimits

SAMPLES = 500
"""Number of random positions that are checked for self-collision."""
MARGIN_M = 0.005
NEAR_SHARE = 0.8
"""Distance that streams keep between links, as a share of the distance between links that are always close to
each other.
"""
VELOCITY = {False: 1.0, True: 0.25}
"""Guessed velocity of a rotary joint, rad/s, and a linear joint, m/s."""
ACCELERATION_PER_VELOCITY, JERK_PER_ACCELERATION = 4.0, 10.0
"""Guessed ratios: full speed is reached within a quarter of a second, full acceleration within a tenth."""
MAX_ACCELERATION = 100.0
"""The largest acceleration that is guessed, rad/s² or m/s². A velocity that needs a larger acceleration,
such as 1e4, is treated as a placeholder.
"""
MANY_TURNS_RAD = 8.0 * np.pi
"""Range above which the file probably uses degrees, because few joints turn that far."""
EFFORT_RESERVE = 2.5
"""Factor for the guessed effort. It multiplies the largest effort that gravity and the guessed acceleration
need in the samples.
"""

EARTH = (0.0, 0.0, -9.81)
"""Gravity, m/s²."""


def base_and_tcp(
    spec: mujoco.MjSpec, joints: list[str], base: str | None, tcp: str, guessed: list[str]
) -> tuple[str, str]:
    """The base frame, guessed if `base` is None, and the TCP. If the TCP is a body, a site is added.

    Raises:
        ConfigError: the base does not exist, or it moves.
    """
    standing = [body.name for body in spec.bodies if not _moves(body)]
    if base is not None and base not in standing:
        told = "moves with the joints" if spec.body(base) else "is not a link of the file"
        valid = ", ".join(name for name in standing if not name.startswith(WORLD))
        raise ConfigError(f"--base: {base!r} {told}; valid names: {valid}")
    if base is None:
        base = spec.joint(joints[0]).parent.parent.name
        guessed.append(f"base_frame {base}: the link below the first joint (--base)")
    if spec.site(tcp) is None and spec.body(tcp) is not None:
        spec.body(tcp).add_site(name=tcp)
    return base, tcp


def _moves(body: mujoco.MjsBody | None) -> bool:
    while body is not None:
        if body.joints:
            return True
        body = body.parent
    return False


def limits(
    file: Path, mj: mujoco.MjModel, rates: dict[str, tuple[float, float]], guessed: list[str]
) -> JointLimits:
    """Limits made from the model's ranges and from the velocities and efforts in the file, where 0 means
    unknown. An unknown effort stays 0; see `efforts`.

    Raises:
        ConfigError: a linear joint has no range.
    """
    names = tuple(mj.joint(index).name for index in range(mj.njnt))
    ranges, velocities, known = np.zeros((len(names), 2)), np.zeros(len(names)), np.zeros(len(names))
    for index, name in enumerate(names):
        slides = bool(mj.jnt_type[index] == mujoco.mjtJoint.mjJNT_SLIDE)
        low, high = ranges[index] = mj.jnt_range[index]
        if not mj.jnt_limited[index]:
            if slides:
                rangeless = [
                    mj.joint(each).name
                    for each in range(mj.njnt)
                    if not mj.jnt_limited[each] and mj.jnt_type[each] == mujoco.mjtJoint.mjJNT_SLIDE
                ]
                raise ConfigError(
                    f"{file}: the slide {name!r} has no range; give it a range in m, or keep all such joints "
                    f"where they are with {typed('--without', *rangeless)}"
                )
            ranges[index] = -2.0 * np.pi, 2.0 * np.pi
            guessed.append(f"{name}: position ±6.28319 rad, because the file has no range")
        elif not slides and np.abs(ranges[index]).max() > MANY_TURNS_RAD:
            guessed.append(
                f"{name}: position {low:g} to {high:g} rad as in the file; these values look like degrees"
            )
        velocity, effort = rates.get(name, (0.0, 0.0))
        if velocity <= 0.0:
            velocity = VELOCITY[slides]
            guessed.append(f"{name}: velocity {velocity:g} {'m' if slides else 'rad'}/s")
        if mj.jnt_actfrclimited[index]:
            bound = float(np.abs(mj.jnt_actfrcrange[index]).min())
            effort = min(effort, bound) if effort > 0.0 else bound
        if velocity * ACCELERATION_PER_VELOCITY > MAX_ACCELERATION:
            unit = "m" if slides else "rad"
            guessed.append(
                f"{name}: acceleration limited to {MAX_ACCELERATION:g} {unit}/s², though the file gives a "
                f"velocity of {velocity:g} {unit}/s"
            )
        velocities[index], known[index] = velocity, effort
    guessed.append("acceleration: 4 times the velocity per second; jerk: 10 times the acceleration")
    accelerations = np.minimum(ACCELERATION_PER_VELOCITY * velocities, MAX_ACCELERATION)
    jerks = JERK_PER_ACCELERATION * accelerations
    return JointLimits(names, ranges[:, 0], ranges[:, 1], velocities, accelerations, jerks, known)


def efforts(robot: RobotModel, guessed: list[str]) -> Array:
    """The efforts in the limits. An effort of 0 is replaced by the effort that the arm needs, with a
    reserve.
    """
    limits, needed = robot.limits, np.zeros(robot.limits.dof)
    for joints in _samples(limits)[:100]:
        accelerating = np.abs(robot.mass_matrix(joints)) @ limits.max_acceleration
        needed = np.maximum(needed, np.abs(robot.gravity_torques(joints)) + accelerating)
    known = limits.max_effort > 0.0
    for joint in np.flatnonzero(~known):
        needed[joint] = max(1.0, np.ceil(EFFORT_RESERVE * needed[joint]))
        guessed.append(
            f"{limits.names[joint]}: effort {needed[joint]:g} {limits.effort_unit(int(joint))}, "
            f"{EFFORT_RESERVE:g} times what the arm needs"
        )
    return np.where(known, limits.max_effort, needed)


def write_limits(limits: JointLimits, file: Path) -> None:
    """Write the limits to a YAML file in the form that cobot and MoveIt read."""
    entries = {}
    for index, name in enumerate(limits.names):
        low, high = float(limits.min_position[index]), float(limits.max_position[index])
        entry = {"has_position_limits": True, "min_position": low, "max_position": high}
        for rate in ("velocity", "acceleration", "jerk", "effort"):
            value = float(getattr(limits, f"max_{rate}")[index])
            entry |= {f"has_{rate}_limits": True, f"max_{rate}": value}
        entries[name] = entry
    file.write_text(yaml.safe_dump({"joint_limits": entries}, sort_keys=False))


def pairs_that_touch(
    robot: RobotModel, disabled: list[tuple[str, str]], guessed: list[str]
) -> list[tuple[str, str]]:
    """The pairs of links that are within 5 mm of each other in every sample, except disabled pairs.

    Each solid of the surroundings is treated as a separate link, but only if no sample is inside the solid.
    """
    checker = CollisionChecker(robot, MARGIN_M, map(frozenset, disabled))
    distances = checker.clearance.distances(_samples(robot.limits), MARGIN_M)
    touching = distances < MARGIN_M
    bodies = robot.mj.geom_bodyid
    of_links: dict[tuple[str, str], NDArray[np.bool_]] = {}
    for pair in np.flatnonzero(touching.any(axis=0)):  # the shapes of two links that touch may vary
        by_body = sorted(checker.pairs[pair], key=lambda geom: int(bodies[geom]))
        inside = 0 in bodies[by_body] and distances[:, pair].min() < 0.0
        both = checker.name(by_body[0]), checker.name(by_body[1])
        found = touching[:, pair] & (not inside)
        of_links[both] = found | of_links.get(both, np.zeros(len(touching), bool))
    pairs = [both for both, touch in of_links.items() if touch.all()]
    also = ", which the SRDF does not disable" if disabled else ""
    guessed += [
        f"{first} and {second} may touch, because they do in each of {SAMPLES} positions{also}"
        for first, second in pairs
    ]
    return pairs


def stream_margin(
    robot: RobotModel, collision: CollisionChecker, usual_m: float, guessed: list[str]
) -> float:
    """The distance that streams and jogging keep, usually `usual_m`. If some links of the arm are closer to
    each other in every collision-free position, a smaller distance is returned, because a stream would
    otherwise stop everywhere.
    """
    samples = _samples(robot.limits)
    free = samples[[collision.is_free(joints) for joints in samples]]
    if not len(free):
        return usual_m
    apart = collision.clearance.distances(free, usual_m)
    near = np.flatnonzero((apart < usual_m).all(axis=0))
    if not len(near):
        return usual_m
    nearest = near[apart[:, near].min(axis=0).argmin()]
    least_m = float(apart[:, nearest].min())
    margin_m = max(MARGIN_M, int(1e3 * NEAR_SHARE * least_m) * 1e-3)
    links = " and ".join(collision.names(int(nearest)))
    guessed.append(
        f"streaming.collision_margin_m {margin_m:.3f}: {links} are always closer than the usual "
        f"{1e3 * usual_m:.0f} mm, but at least {1e3 * least_m:.0f} mm apart"
    )
    return round(margin_m, 3)


def report_odd_world(mj: mujoco.MjModel, guessed: list[str]) -> None:
    """Report origins that look as if they were in millimetres, and gravity that differs from the Earth's."""
    moving = mj.body_weldid != 0
    length_m = float(np.linalg.norm(mj.body_pos[moving], axis=1).sum())
    if length_m >= LARGE_M:
        guessed.append(
            f"the origins of the moving links add up to {length_m:.4g} m, which looks like millimetres: "
            "URDF and MJCF use metres"
        )
    if not np.allclose(mj.opt.gravity, EARTH, atol=0.05):
        words = ", ".join(f"{value:.4g}" for value in mj.opt.gravity)
        guessed.append(f"gravity is that of the file: {words} m/s² along x, y, z of the world")


def report_without_shape(robot: RobotModel, guessed: list[str]) -> None:
    """Report the links that have no collision shape."""
    mj = robot.mj
    colliding = {geom for geom in range(mj.ngeom) if mj.geom_contype[geom]}
    colliding.update(mj.pair_geom1.tolist(), mj.pair_geom2.tolist())
    shapes = {int(mj.geom_bodyid[geom]) for geom in colliding}
    bare = [mj.body(int(body)).name for body in mj.jnt_bodyid if int(body) not in shapes]
    if bare:
        guessed.append(
            f"links without a collision shape, so their collisions are not detected: {', '.join(bare)}"
        )


def _samples(limits: JointLimits) -> Array:
    size = (SAMPLES, limits.dof)
    return np.random.default_rng(0).uniform(limits.min_position, limits.max_position, size)
