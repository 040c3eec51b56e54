"""Programs under disturbances. Oracles: pinocchio's dynamics and kinematics with the load, scipy's normal
distribution.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pinocchio
import pytest
import scipy.stats
from independent_models import Pinocchio

from cobot.config import Settings
from cobot.errors import CobotError, ConfigError
from cobot.motions.planners import PlannerName
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.robot.description import RobotDescription
from cobot.studies import Study, study_of
from cobot.studies.kinds.disturbances import UnknownLoad
from cobot.types import Array, Scaling
from rtloop.rehearsal import rehearse

PART = {"pose": [0.5, 0, 0.3, 0, 1, 0, 0], "tolerance_m": 0.002}


def robustness(space: dict[str, Any], samples: int | None = None, program: Any = None, **more: Any) -> Study:
    document = {
        "question": "Does it work?",
        "kind": "robustness",
        "program": program or [{"to": "work"}, PART],
        "space": space,
        "samples": samples,
    }
    return study_of({key: value for key, value in (document | more).items() if value is not None})


def peak_efforts(
    settings: Settings, robot: RobotDescription, payload_kg: float, speed: float
) -> tuple[Array, Array]:
    """The largest efforts of a motion with an unknown load, in the simulation and by pinocchio, N·m."""
    start, goal = (np.array(robot.positions[name].joints) for name in ("home", "work"))
    motion = plan(robot, MotionRequest(start, goal, PlannerName.PTP, Scaling(speed)))
    assert motion is not None
    load = UnknownLoad(robot, motion, payload_kg, 0.0, 0.0, np.random.default_rng(0))
    wide = settings.model_copy(update={"rt": settings.rt.model_copy(update={"settle_position_rad": 0.1})})
    run = rehearse(wide, robot, start, motion, load)
    assert run.flaw is None
    other = Pinocchio()
    last = other.model.njoints - 1
    placement = other.model.frames[other.tcp].placement
    mass = pinocchio.Inertia(payload_kg, placement.translation, np.zeros((3, 3)))
    other.model.inertias[last] = other.model.inertias[last] + mass
    data = other.model.createData()
    times = np.linspace(0.0, motion.duration_s, 400)
    rows = zip(*(motion.sample(times, derivative) for derivative in range(3)), strict=True)
    efforts = np.abs([pinocchio.rnea(other.model, data, *row) for row in rows]).max(axis=0)
    return run.effort * robot.limits.max_effort, efforts


@pytest.mark.parametrize(("payload_kg", "speed"), [(0.0, 0.5), (3.0, 0.1), (3.0, 1.0)])
def test_an_unknown_load_is_carried_as_a_mass_would_be(
    payload_kg: float, speed: float, settings: Settings, robot: RobotDescription
) -> None:
    ours, theirs = peak_efforts(settings, robot, payload_kg, speed)
    large = theirs > 20.0
    assert large.any()
    np.testing.assert_allclose(ours[large], theirs[large], rtol=0.06)


@pytest.mark.thorough
def test_the_share_is_that_of_parts_within_the_tolerance() -> None:
    study = robustness({"part_x_m": {"normal": [0, 0.002]}}, 40)
    columns = study.kernel()(0, 40)
    within = np.abs(np.asarray(columns["part_x_m"], float)) <= 0.002
    assert (columns["success"] == within).all()
    np.testing.assert_allclose(columns["error_m"], np.abs(np.asarray(columns["part_x_m"], float)), atol=1e-5)
    expected = scipy.stats.norm(0, 0.002).cdf(0.002) * 2 - 1
    assert abs(within.mean() - expected) < 3 * np.sqrt(expected * (1 - expected) / 40)
    missed = [str(each) for each in columns["cause"] if each]
    assert all(each.startswith("program[1]: misses the part by 0.00") for each in missed)
    answer = study.answer({"task": np.arange(40), **columns})
    assert answer["success"].startswith(f"{within.mean():.4g} ({within.sum()} of 40), 95 % interval ")
    (cause,) = (name for name in answer if name.startswith("failed because"))
    assert cause == "failed because program[1]: misses the part by ... m, allowed: ... m"
    assert answer[cause] == 40 - within.sum()


@pytest.mark.thorough
def test_errors_of_the_joints_become_errors_of_the_tcp(robot: RobotDescription) -> None:
    """Oracle: for small errors the variance is the sum of the squares of pinocchio's Jacobian."""
    deviation = 5e-4
    goal = [{"to": "home"}, {"to": "work", "tolerance_m": 1.0}]
    study = robustness({"joint_offset_rad": {"values": [deviation]}}, 60, goal)
    errors = np.asarray(study.kernel()(0, 60)["error_m"], float)
    jacobian = Pinocchio().jacobian(np.array(robot.positions["work"].joints))[:3]
    assert np.mean(errors**2) == pytest.approx(deviation**2 * (jacobian**2).sum(), rel=0.4)


def test_a_task_is_the_same_in_any_chunk() -> None:
    space = {"payload_kg": {"normal": [0, 0.3]}, "encoder_noise_rad": {"values": [0.0, 1e-5]}}
    study = robustness(space, 3)
    whole, part = study.kernel()(0, 6), study.kernel()(3, 5)
    assert all(np.array_equal(whole[name][3:5], part[name]) for name in whole)


@pytest.mark.parametrize(
    ("space", "cause"),
    [
        ({"friction_nm": {"values": [60.0]}}, r"not settled|TRACKING"),
        (
            {"payload_kg": {"values": [60.0]}},
            r"the drive reaches its limit of|the real-time loop rejects|not settled",
        ),
        ({"encoder_noise_rad": {"values": [0.05]}}, r"program\[1\]"),
    ],
)
def test_a_run_that_fails_says_where_and_why(space: dict[str, Any], cause: str) -> None:
    columns = robustness(space).kernel()(0, 1)
    assert not columns["success"][0]
    assert str(columns["cause"][0]).startswith("program[1]")
    assert re.search(cause, str(columns["cause"][0]))


@pytest.mark.parametrize(
    ("space", "more", "message"),
    [
        (
            {"payload": {"values": [1]}},
            {},
            r"unknown parameter 'payload' \(did you mean 'payload_kg'\?\)",
        ),
        ({"speed": {"uniform": [0.1, 1]}}, {}, "space.speed: must be an axis of the grid"),
        ({}, {"program": [{"to": "home"}]}, "program: must have at least 2 items"),
        ({}, {"program": [{"to": "home"}, {}]}, r"program\[1\]: must have either to or pose"),
        ({}, {"program": [{"to": "home"}, {"to": "work", "planner": "lim"}]}, r"program\[1\].planner"),
        ({}, {"metric": "succes"}, "metric: must be"),
    ],
)
def test_a_bad_study_names_the_key(space: dict[str, Any], more: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        robustness(space, **more)


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ([PART, PART], r"program\[0\]: needs the key to"),
        (
            [{"to": "home"}, {"to": "wrk"}],
            r"program\[1\].to: unknown position 'wrk' \(did you mean 'work'",
        ),
        ([{"to": "home"}, {"pose": [2, 0, 0, 1, 0, 0, 0]}], r"program\[1\]: .*(reach|unreachable|no joint)"),
        ([{"to": "home"}, {"pose": [0.5, 0, 0.3, 0, 0, 0, 0]}], r"program\[1\].pose: the quaternion"),
    ],
)
def test_a_program_that_cannot_be_planned_is_found_before_it_begins(program: Any, message: str) -> None:
    with pytest.raises(CobotError, match=message):
        robustness({}, program=program).kernel()


def test_a_declared_tool_helps_where_an_unknown_one_fails() -> None:
    program = [{"to": "home"}, {"to": "work"}]
    unknown = robustness({"payload_kg": {"values": [6.0]}}, program=program)
    known = robustness({}, program=program, robot={"tool": {"mass": 6.0}})
    assert not unknown.kernel()(0, 1)["success"][0]
    assert known.kernel()(0, 1)["success"][0]
