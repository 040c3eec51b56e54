"""The compiled trajectory generator against Ruckig, and against what a motion must keep in any case."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import ruckig
from sample_counts import samples
from thorough import few

from cobot.types import Array
from rtloop.generators import otg

SEED = 20261122
OK, INVALID, NO_SOLUTION = 0, 1, 2
AXES = 50
"""Random problems are solved by Ruckig in batches, each of them an axis for itself."""
TOLERANCE = 1e-9
NAMES = (
    "current_position",
    "current_velocity",
    "current_acceleration",
    "target_position",
    "target_velocity",
    "min_velocity",
    "max_velocity",
    "min_acceleration",
    "max_acceleration",
    "max_jerk",
)


def _log_uniform(rng: np.random.Generator, low: float, high: float, n: int) -> Array:
    result: Array = np.exp(rng.uniform(math.log(low), math.log(high), n))
    return result


def _one_of(rng: np.random.Generator, *columns: Array) -> Array:
    """Each element from one of the columns."""
    return np.choose(rng.integers(len(columns), size=len(columns[0])), columns)


def _rows(rng: np.random.Generator, kind: str, n: int) -> Array:
    """Random problems of a kind, shape (n, 10)."""
    max_velocity, max_acceleration = _log_uniform(rng, 0.05, 10.0, n), _log_uniform(rng, 0.1, 50.0, n)
    jerk = _log_uniform(rng, 1.0, 2000.0, n)
    skewed = rng.random(n) < 0.5
    min_velocity = -max_velocity * np.where(skewed, rng.uniform(0.1, 2.0, n), 1.0)
    min_acceleration = -max_acceleration * np.where(skewed, rng.uniform(0.1, 2.0, n), 1.0)
    velocity = rng.uniform(min_velocity, max_velocity)
    acceleration = rng.uniform(min_acceleration, max_acceleration)
    arrival = 0.99 * rng.uniform(min_velocity, max_velocity)
    offset = rng.uniform(min_velocity, max_velocity) * _log_uniform(rng, 1e-3, 10.0, n)
    position = np.where(rng.random(n) < 0.5, 0.0, rng.uniform(-3.0, 3.0, n))
    if kind == "beyond":
        factor = rng.choice([1.0, 1.5, 3.0, 6.0], n)
        velocity, acceleration = factor * velocity, rng.choice([1.0, 1.5, 3.0], n) * acceleration
    elif kind == "edges":
        zero = np.zeros(n)
        velocity = _one_of(rng, zero, min_velocity, max_velocity, 0.99 * max_velocity, velocity)
        acceleration = _one_of(rng, zero, min_acceleration, max_acceleration, acceleration)
        arrival = _one_of(rng, zero, 0.99 * max_velocity, 0.99 * min_velocity, arrival)
        tiny = rng.choice([0.0, 1e-12, -1e-12, 1e-6, -1e-6], n)
        offset = _one_of(rng, zero, tiny, 1e-3 * velocity, 1e-3 * arrival, offset)
    elif kind == "near rest":
        scale = _log_uniform(rng, 1e-6, 1.0, n)
        velocity, arrival = scale * velocity, np.where(rng.random(n) < 0.5, 0.0, scale * arrival)
        acceleration *= _log_uniform(rng, 1e-6, 1.0, n)
        offset = 1e-3 * rng.uniform(min_velocity, max_velocity) * _log_uniform(rng, 1e-4, 1.0, n)
    elif kind == "to rest":
        arrival = np.zeros(n)
    return np.column_stack(
        [
            position,
            velocity,
            acceleration,
            position + offset,
            arrival,
            min_velocity,
            max_velocity,
            min_acceleration,
            max_acceleration,
            jerk,
        ]
    )


def _ruckig(
    rows: Array,
    interface: ruckig.ControlInterface = ruckig.ControlInterface.Position,
    synchronization: ruckig.Synchronization = ruckig.Synchronization.No,
) -> ruckig.Trajectory | None:
    problem, trajectory = ruckig.InputParameter(len(rows)), ruckig.Trajectory(len(rows))
    problem.control_interface, problem.synchronization = interface, synchronization
    for name, column in zip(NAMES, rows.T.tolist(), strict=True):
        setattr(problem, name, column)
    try:
        ruckig.Ruckig(len(rows)).calculate(problem, trajectory)
    except (ruckig.RuckigError, ValueError):  # ValueError: a result that its binding does not know
        return None
    return trajectory


def _end(phases: list[tuple[float, ...]]) -> tuple[float, float, float]:
    """Where the last phase leads."""
    duration, jerk, p, v, a = phases[-1]
    return (
        p + duration * (v + duration * (a / 2 + duration * jerk / 6)),
        v + duration * (a + duration * jerk / 2),
        a + duration * jerk,
    )


def _flaws(row: Array, motion: otg.AxisProfile) -> list[str]:
    """What a motion does not keep of a problem: end, continuity, limits where the start keeps them."""
    p0, v0, a0, target, arrival, min_v, max_v, min_a, max_a, jerk = row.tolist()
    phases, flaws = motion.phases, []
    size = max(1.0, abs(p0), abs(target), max(max_v, -min_v, abs(v0)) * motion.duration)
    state = (p0, v0, a0)
    for i, (duration, j, *start) in enumerate(phases):
        if (
            abs(start[0] - state[0]) > TOLERANCE * size
            or np.abs(np.subtract(start[1:], state[1:])).max() > 1e-9
        ):
            flaws.append(f"phase {i} begins at {start}, not at {state}")
        if abs(j) > jerk * (1.0 + 1e-12):
            flaws.append(f"jerk {j} in phase {i}")
        state = _end(phases[: i + 1])
        if not min(min_a, a0) - 1e-9 <= state[2] <= max(max_a, a0) + 1e-9:
            flaws.append(f"acceleration {state[2]} after phase {i}")
        # At both ends of a phase and where its acceleration is zero; a start may make overshoot inevitable.
        top, bottom = v0 + max(a0, 0.0) ** 2 / (2 * jerk), v0 - min(a0, 0.0) ** 2 / (2 * jerk)
        velocities = [state[1]]
        if j and 0.0 < -start[2] / j < duration:
            velocities.append(start[1] - start[2] ** 2 / (2 * j))
        if min(velocities) < min(min_v, bottom) - 1e-9 or max(velocities) > max(max_v, top) + 1e-9:
            flaws.append(f"velocities {velocities} in phase {i}")
    off = np.subtract(state, (target, arrival, 0.0))
    if abs(off[0]) > TOLERANCE * size or np.abs(off[1:]).max() > TOLERANCE:
        flaws.append(f"ends {off} off the target")
    return flaws


def _compare(rng: np.random.Generator, rows: Array, interface: ruckig.ControlInterface, seed: int) -> int:
    """Compare a batch with Ruckig's; the number of problems on which both do not agree, each explained."""
    position = interface == ruckig.ControlInterface.Position
    results = [(otg.position if position else otg.velocity)(row) for row in rows.tolist()]
    theirs = _ruckig(rows, interface)
    if theirs is None and len(rows) > 1:  # It refuses one of them.
        halves = np.array_split(rows, 2)
        return sum(_compare(rng, half, interface, seed) for half in halves)
    ours = [motion for _, motion in results]
    for row, (result, _) in zip(rows, results, strict=True):
        assert result == OK, f"seed {seed}: {result} for {row.tolist()}"
    if theirs is None:
        assert not _flaws(rows[0], ours[0]), f"seed {seed}: {_flaws(rows[0], ours[0])} for {rows[0].tolist()}"
        return 1
    durations = np.array([motion.duration for motion in ours])
    expected = np.array(theirs.independent_min_durations)
    differing = np.abs(durations - expected) > TOLERANCE * np.maximum(1.0, expected)
    for i in np.flatnonzero(differing):
        _explain(rows[i], ours[i], expected[i], seed)
    # A state differs by its rate times the difference of the durations, beside the rounding.
    rates = np.abs([rows[:, [1, 5, 6]].T, rows[:, [2, 7, 8]].T, rows[:, [9, 9, 9]].T]).max(axis=1)
    if not position:
        rates[0] = np.abs(rows[:, [1, 4]]).max(axis=1) + rates[1] ** 2 / rows[:, 9]
    shift = np.abs(durations - expected) + 1e-12 * np.maximum(1.0, expected)
    for time_s in rng.uniform(0.0, 1.1, 4) * rng.choice(expected, 4):
        states = np.array([motion.at(time_s) for motion in ours]).T
        off = np.abs(states - np.array(theirs.at_time(time_s)))
        sizes = np.maximum(1.0, [np.abs(states[0]) + rates[0] * time_s, rates[0], rates[1]])
        bad = np.flatnonzero((off > TOLERANCE * sizes + rates * shift).any(axis=0) & ~differing)
        assert not bad.size, f"seed {seed}: at {time_s} s {off[:, bad[:1]].T} for {rows[bad[:1]].tolist()}"
    return int(differing.sum())


def _explain(row: Array, motion: otg.AxisProfile, expected: float, seed: int) -> None:
    """Of two motions the shorter one is right if it is a motion at all."""
    if motion.duration < expected:
        assert not _flaws(row, motion), f"seed {seed}: {_flaws(row, motion)} for {row.tolist()}"
        return
    theirs = _ruckig(row[None])
    assert theirs is not None
    just_before = expected * (1.0 - 1e-15)
    state = np.array(theirs.at_time(just_before))[:, 0]
    missed = abs(state[0] + state[1] * (expected - just_before) - row[3])
    assert missed > 1e-13, f"seed {seed}: {motion.duration}, not {expected}, for {row.tolist()}"


@pytest.mark.parametrize("kind", few(["any", "to rest", "edges", "near rest", "beyond"], 2))
def test_a_position_is_reached_as_ruckig_reaches_it(kind: str) -> None:
    rng, n = np.random.default_rng(SEED), samples(2_500) * 10
    rows = _rows(rng, kind, n)
    batches = rows.reshape(-1, AXES, 10)
    disagreements = sum(_compare(rng, batch, ruckig.ControlInterface.Position, SEED) for batch in batches)
    assert disagreements <= 0.02 * n, f"seed {SEED}: {disagreements} of {n}"


def test_a_velocity_is_reached_as_ruckig_reaches_it() -> None:
    rng, n = np.random.default_rng(SEED), samples(5_000) * 10
    rows = np.concatenate([_rows(rng, kind, n // 2) for kind in ("beyond", "edges")])
    batches = rows.reshape(-1, AXES, 10)
    disagreements = sum(_compare(rng, batch, ruckig.ControlInterface.Velocity, SEED) for batch in batches)
    assert disagreements == 0


@pytest.mark.parametrize("kind", ["any", "edges", "near rest", "beyond"])
def test_a_motion_is_continuous_within_the_limits_and_ends_at_the_target(kind: str) -> None:
    rng = np.random.default_rng(SEED + 1)
    for row in _rows(rng, kind, samples(5_000)):
        result, motion = otg.position(row.tolist())
        flaws = _flaws(row, motion)
        assert result == OK, f"seed {SEED}: {row.tolist()}"
        assert not flaws, f"seed {SEED}: {flaws} for {row.tolist()}"


def test_extrema_are_those_of_the_path() -> None:
    rng = np.random.default_rng(SEED)
    for row in np.concatenate([_rows(rng, kind, samples(500)) for kind in ("any", "beyond")]):
        _, motion = otg.position(row.tolist())
        times = np.linspace(0.0, motion.duration, 400)
        path = [motion.at(t)[0] for t in times]
        low, high = motion.extrema
        # Between two samples a path turns by no more than its greatest acceleration permits.
        turn = np.abs(row[[2, 7, 8]]).max() * times[1] ** 2 / 8.0 + 1e-9 * max(1.0, np.abs(path).max())
        rounding = 1e-12 * max(1.0, np.abs(path).max())
        assert min(path) - turn <= low <= min(path) + rounding, row.tolist()
        assert max(path) - rounding <= high <= max(path) + turn, row.tolist()


def _row(**changes: float) -> list[float]:
    """A problem that is one: from rest to rest, 1 rad away."""
    row = dict.fromkeys(NAMES, 0.0) | {"target_position": 1.0}
    row |= {"min_velocity": -1.0, "max_velocity": 1.0, "min_acceleration": -2.0, "max_acceleration": 2.0}
    return list((row | {"max_jerk": 10.0} | changes).values())


def test_who_is_there_stays() -> None:
    result, motion = otg.position(_row(current_position=0.5, target_position=0.5))
    assert (result, motion.duration, motion.phases) == (OK, 0.0, [])
    assert motion.at(0.0) == motion.at(1.0) == (0.5, 0.0, 0.0)
    assert motion.extrema == (0.5, 0.5)


def test_who_is_on_the_way_goes_on_at_the_targets_velocity() -> None:
    _, motion = otg.position(_row(target_velocity=0.5))
    assert motion.at(motion.duration + 2.0) == (2.0, 0.5, 0.0)
    assert motion.at(-1.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("distance", [1e-15, 1e-12, 1e-9, 1e-6, 1e-3])
def test_a_small_way_takes_four_phases_of_the_jerk(distance: float) -> None:
    _, motion = otg.position(_row(target_position=distance))
    assert motion.duration == pytest.approx(4.0 * (distance / 20.0) ** (1.0 / 3.0), rel=1e-12)


@pytest.mark.parametrize("share", [0.99, 1.0])
def test_a_target_may_move_as_fast_as_the_limit(share: float) -> None:
    row = _row(target_velocity=share)
    result, motion = otg.position(row)
    assert result == OK
    assert not _flaws(np.array(row), motion)


def test_two_equal_limits_of_velocity_leave_no_way_beyond_them() -> None:
    assert otg.position(_row(max_velocity=0.0))[0] == NO_SOLUTION
    assert otg.position(_row(max_velocity=0.0, target_position=-1.0))[0] == OK


@pytest.mark.parametrize(
    "changes",
    [
        {"max_jerk": 0.0},
        {"max_jerk": -1.0},
        {"max_acceleration": 0.0},
        {"min_acceleration": 0.0},
        {"target_velocity": 1.5},
        {"target_velocity": -1.5},
        {"min_velocity": 0.5, "target_velocity": 0.2},
    ],
)
def test_limits_that_are_none_are_refused(changes: dict[str, float]) -> None:
    assert otg.position(_row(**changes))[0] == INVALID


@pytest.mark.parametrize(("name", "value"), list(itertools.product(NAMES, [math.nan, math.inf, -math.inf])))
def test_what_is_no_number_is_refused(name: str, value: float) -> None:
    assert otg.position(_row(**{name: value}))[0] == INVALID
    if name not in ("target_position", "min_velocity", "max_velocity"):
        assert otg.velocity(_row(**{name: value}))[0] == INVALID
    assert otg.step(_row(**{name: value}), 1e-3)[0] == INVALID
    assert otg.vector([_row(), _row(**{name: value})])[0] == INVALID


def test_random_bits_give_a_motion_or_a_result() -> None:
    """And never anything else, in a time that is bounded."""
    rng = np.random.default_rng(SEED)
    shape = samples(50_000), 10
    bits = rng.integers(0, 2**64, shape, dtype=np.uint64).view(np.float64)
    large = np.exp(rng.uniform(-300.0, 300.0, shape)) * rng.choice([-1.0, 1.0], shape)
    large[:, [5, 7]], large[:, [6, 8, 9]] = -np.abs(large[:, [5, 7]]), np.abs(large[:, [6, 8, 9]])
    for row in np.concatenate([bits, large]).tolist():
        for plan in (otg.position, otg.velocity):
            result, motion = plan(row)
            assert result in (OK, INVALID, NO_SOLUTION)
            if result == OK:
                assert np.isfinite(motion.at(0.5 * motion.duration)).all(), row
                assert np.isfinite(motion.extrema).all(), row


def test_a_step_is_a_plan_after_one_period() -> None:
    rng = np.random.default_rng(SEED)
    for row in _rows(rng, "near rest", samples(1_000)).tolist():
        assert otg.step(row, 1e-3) == (OK, otg.position(row)[1].at(1e-3))


def test_who_plans_anew_in_every_period_arrives_when_the_first_plan_says() -> None:
    """Towards a target that moves, too: to be a rounding too far ahead of it must not cost a run-up."""
    rng = np.random.default_rng(SEED)
    for row in _rows(rng, "any", samples(400)).tolist():
        _, plan = otg.position(row)
        time_s, state = 0.0, row[:3]
        while time_s + 1e-3 < plan.duration < 2.0:
            result, state = otg.step([*state, *row[3:]], 1e-3)
            time_s += 1e-3
            left = otg.position([*state, *row[3:]])[1].duration
            assert result == OK
            assert time_s + left == pytest.approx(plan.duration, abs=1e-3), f"seed {SEED}: {row}"


def _line(rng: np.random.Generator, kind: str, n: int) -> tuple[Array, Array]:
    """Problems of n axes of which the motion is on a line, and its direction."""
    direction = rng.uniform(0.2, 1.0, n) * rng.choice([-1.0, 1.0], n)
    rows = _rows(rng, kind, n)
    rows[:, :5] = direction[:, None] * _rows(rng, kind, 1)[0, :5]
    rows[:, 5:9:2] = -rows[:, 6:9:2]
    return rows, direction


def test_axes_on_a_line_stay_on_it_within_the_limits_of_each() -> None:
    rng = np.random.default_rng(SEED)
    in_phase = 0
    for _ in range(samples(800)):
        rows, direction = _line(rng, "near rest", 3)
        if (np.abs(rows[:, 4]) > rows[:, 6]).any():
            continue
        result, motions = otg.vector(rows.tolist())
        assert result == OK
        if len({motion.duration for motion in motions}) > 1:
            continue
        in_phase += 1
        within = (np.abs(rows[:, 1]) + rows[:, 2] ** 2 / rows[:, 9] < rows[:, 6]).all()
        within &= bool((np.abs(rows[:, 2]) <= rows[:, 8]).all())
        for time_s in np.linspace(0.0, motions[0].duration, 20):
            states = np.array([motion.at(time_s) for motion in motions])
            along = (states - rows[:, :3] * [1.0, 0.0, 0.0]) / direction[:, None]
            assert np.abs(along - along[0]).max(axis=0) == pytest.approx(0.0, abs=1e-9), rows.tolist()
        if within:
            for row, motion in zip(rows, motions, strict=True):
                assert not _flaws(row, motion), f"seed {SEED}: {rows.tolist()}"
    assert in_phase > samples(400)


def test_where_ruckig_keeps_axes_in_phase_it_is_the_same_motion() -> None:
    rng, compared = np.random.default_rng(SEED), 0
    for _ in range(samples(500)):
        direction = np.array([1.0, 0.5, -0.25])
        rows = np.repeat(_rows(rng, "any", 1), 3, axis=0)
        rows[:, 5:9:2] = -rows[:, 6:9:2]
        rows[:, 4] = np.clip(rows[:, 4], 0.99 * rows[:, 5], 0.99 * rows[:, 6])
        rows[:, 3] -= rows[:, 0]
        rows[:, 0] = 0.0
        rows[:, :5] *= direction[:, None]
        theirs = _ruckig(rows, synchronization=ruckig.Synchronization.Phase)
        result, motions = otg.vector(rows.tolist())
        assert result == OK
        if theirs is None or theirs.duration > 100.0:
            continue
        for time_s in np.linspace(0.0, theirs.duration, 10):
            expected = np.array(theirs.at_time(time_s))
            along = (expected[0] - rows[:, 0]) / direction
            if np.ptp(along) > 1e-9:
                break  # Out of phase.
            compared += 1
            states = np.array([motion.at(time_s) for motion in motions]).T
            size = np.maximum(1.0, np.abs(rows).max())
            assert states[:2] == pytest.approx(expected[:2], abs=1e-9 * size * max(1.0, theirs.duration))
    assert compared > samples(1_000)


@pytest.mark.parametrize("kind", few(["any", "to rest", "near rest"]))
def test_axes_that_are_on_no_line_arrive_together_as_with_ruckig(kind: str) -> None:
    rng, compared = np.random.default_rng(SEED), 0
    for _ in range(samples(3_000)):
        rows = _rows(rng, kind, 3)
        theirs = _ruckig(rows, synchronization=ruckig.Synchronization.Time)
        result, motions = otg.vector(rows.tolist(), in_phase=False)
        alone = [otg.position(row)[1] for row in rows.tolist()]
        assert result == OK
        assert max(m.duration for m in motions) == max(m.duration for m in alone)
        for row, motion in zip(rows, motions, strict=True):
            assert not _flaws(row, motion), f"seed {SEED}: {_flaws(row, motion)} for {row.tolist()}"
        if theirs is None or abs(theirs.duration - motions[0].duration) > 1e-9 * max(1.0, theirs.duration):
            continue  # An axis with a target that moves may have no motion of just this duration.
        if len({motion.duration for motion in motions}) > 1:
            continue
        before = theirs.duration * (1.0 - 1e-15)
        end = np.array(theirs.at_time(before))
        # Ruckig takes an end within 1e-8, with a velocity of the cruise that is wrong accordingly.
        missed = np.abs(end[0] + end[1] * (theirs.duration - before) - rows[:, 3])
        exact = missed <= 1e-9 * np.abs(rows[:, 3] - rows[:, 0]) * min(1.0, theirs.duration)
        compared += int(exact.sum())
        rates = np.abs([rows[:, [1, 5, 6]].T, rows[:, [2, 7, 8]].T, rows[:, [9, 9, 9]].T]).max(axis=1)
        for time_s in rng.uniform(0.0, theirs.duration, 4):
            states = np.array([motion.at(time_s) for motion in motions]).T
            off = np.abs(states - np.array(theirs.at_time(time_s)))
            sizes = np.maximum(1.0, [np.abs(states[0]) + rates[0] * time_s, rates[0], rates[1]])
            assert (off <= TOLERANCE * (sizes + rates))[:, exact].all(), (
                f"seed {SEED}: {off} for {rows.tolist()}"
            )
    assert compared > samples(2_000)


def test_an_axis_that_cannot_be_delayed_arrives_earlier() -> None:
    """Just ahead of its moving target it takes a run-up or none: nothing in between."""
    rows = [_row(target_velocity=0.5, target_position=0.0, current_velocity=0.5), _row()]
    rows[0][3] = 1e-3
    result, motions = otg.vector(rows, in_phase=False)
    assert result == OK
    for row, motion in zip(rows, motions, strict=True):
        assert not _flaws(np.array(row), motion)


def test_axes_that_are_on_no_line_are_synchronised() -> None:
    rng = np.random.default_rng(SEED)
    rows = _rows(rng, "any", 6).tolist()
    states = [
        [motion.at(0.1) for motion in otg.vector(rows, in_phase=in_phase)[1]] for in_phase in (True, False)
    ]
    assert states[0] == states[1]
