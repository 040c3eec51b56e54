"""A policy moves an arm on virtual time. Oracles: the openpi server package, where it is installed; finite
differences of what was commanded."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from learning_peers import WAIT_S, in_a_loop

from cobot.client import JointImpedanceControl, JointState, Mode
from cobot.client.states import GripperReading
from cobot.config import Settings
from cobot.errors import ExecutionError, InputError, MotionStopped
from cobot.ipc.layout import GripperObject
from cobot.learning.chunks import Latency, actions_of, timed
from cobot.learning.policy import PATIENCE, PolicyRunner, state_observer
from cobot.learning.simulation import Simulation
from cobot.robot.description import RobotDescription

PERIOD_S = 1 / 30
LENGTH = 15


class Swing:
    """A policy that swings the first joint, as seen from where the arm is, and takes its time.

    Attributes:
        takes_s: on the robot's clock.
    """

    def __init__(self, simulation: Simulation, home: np.ndarray, takes_s: float = 0.0) -> None:
        self.simulation, self.home, self.takes_s = simulation, home, takes_s
        self.asked: list[dict[str, Any]] = []

    def infer(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        self.asked.append(dict(observation))
        begun_s = self.simulation.robot.clock_s()
        if self.takes_s:
            self.simulation.clock.sleep(self.takes_s)
        return {"actions": self.points(begun_s + PERIOD_S * np.arange(1, LENGTH + 1))}

    def points(self, times_s: np.ndarray) -> np.ndarray:
        rows = np.tile(self.home, (len(times_s), 1))
        rows[:, 0] += 0.2 * (1.0 - np.cos(1.5 * times_s))
        return np.hstack([rows, np.zeros((len(times_s), 1))])  # and a gripper


@pytest.fixture
def home(robot: RobotDescription) -> np.ndarray:
    return np.array(robot.positions["home"].joints)


@pytest.fixture
def simulation(settings: Settings, robot: RobotDescription, home: np.ndarray) -> Iterator[Simulation]:
    made = Simulation(settings, robot, home)
    yield made
    made.close()


@pytest.fixture
def control(simulation: Simulation) -> JointImpedanceControl:
    simulation.robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
    return simulation.robot.start_joint_impedance_control(30, interpolation="quintic")


def watched(simulation: Simulation) -> list[np.ndarray]:
    """What is commanded in each cycle from now on, shape (3, dof)."""
    seen: list[np.ndarray] = []
    loop = simulation._loop

    def step(count: int) -> None:
        for _ in range(count):
            simulation_step(1)
            seen.append(loop.controller.safety.position.copy())

    simulation_step = simulation._step
    simulation.clock._step = step
    return seen


@pytest.mark.parametrize("takes_s", [0.0, 0.08, 0.25])
def test_a_policy_that_thinks_is_followed_in_step(
    simulation: Simulation,
    control: JointImpedanceControl,
    home: np.ndarray,
    robot: RobotDescription,
    takes_s: float,
) -> None:
    policy = Swing(simulation, home, takes_s)
    runner = PolicyRunner(
        simulation.robot, control, policy, PERIOD_S, clock=simulation.clock, every_s=0.2 + takes_s
    )
    commanded = watched(simulation)
    runner.run(1.0)
    begun_s, first = simulation.robot.clock_s(), len(commanded)
    runner.run(3.0)
    followed = np.array(commanded[first:])
    wanted = policy.points(begun_s + 1e-3 * np.arange(1, len(followed) + 1))[:, :7]
    assert np.abs(followed - wanted).max() < 0.004, "late actions are left out, the others keep their times"
    assert runner.latency.last_s == pytest.approx(takes_s, abs=2e-3)
    assert {each.dropped for each in runner.sent} <= {int(takes_s / PERIOD_S), int(takes_s / PERIOD_S) + 1}
    jerk = np.abs(np.diff(followed, 3, axis=0)).max(axis=0) / 1e-9
    assert (jerk <= robot.limits.max_jerk * 1.001).all(), "chunk is blended into chunk"


def test_a_chunk_is_asked_for_before_the_last_has_run_out(
    simulation: Simulation, control: JointImpedanceControl, home: np.ndarray
) -> None:
    runner = PolicyRunner(
        simulation.robot, control, Swing(simulation, home, 0.2), PERIOD_S, clock=simulation.clock
    )
    runner.run(4.0)
    for before, after in zip(runner.sent[1:], runner.sent[2:], strict=False):
        assert before.times_s[-1] > after.observed_s + after.latency_s
        assert after.times_s[0] - (after.observed_s + after.latency_s) <= PERIOD_S + 1e-9


def test_offsets_are_from_the_observed_posture(
    simulation: Simulation, control: JointImpedanceControl, home: np.ndarray
) -> None:
    class Offsets:
        def infer(self, observation: Mapping[str, Any]) -> dict[str, Any]:
            return {"actions": np.tile([0.05, 0, 0, 0, 0, 0, 0], (LENGTH, 1))}

    runner = PolicyRunner(
        simulation.robot, control, Offsets(), PERIOD_S, meaning="offsets", clock=simulation.clock
    )
    runner.once()
    simulation.clock.sleep(2.0)
    assert simulation.robot.states().q[0] - home[0] == pytest.approx(0.05, abs=2e-3)


def test_a_policy_sees_what_it_was_trained_on(
    simulation: Simulation, control: JointImpedanceControl, home: np.ndarray
) -> None:
    policy = Swing(simulation, home)
    picture = np.zeros((4, 6, 3), np.uint8)
    observe = state_observer("swing", lambda joints: {"front": picture})
    PolicyRunner(simulation.robot, control, policy, PERIOD_S, observe=observe, clock=simulation.clock).once()
    (seen,) = policy.asked
    assert seen["prompt"] == "swing"
    assert seen["observation/front"] is picture
    assert seen["observation/state"] == pytest.approx(home, abs=1e-3)
    assert seen["observation/state"].dtype == np.float32


class Hand:
    """Fingers that note what they are aimed at, and when.

    Attributes:
        aims: on the robot's clock, and the width.
    """

    width_m = (0.0, 0.1)

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self.aims: list[tuple[float, float]] = []

    def aim(self, width: float) -> None:
        self.aims.append((self.simulation.robot.clock_s(), width))


@pytest.mark.parametrize("meaning", ["positions", "offsets"])
def test_fingers_follow_the_column_after_the_joints_at_the_times_of_the_actions(
    simulation: Simulation, control: JointImpedanceControl, home: np.ndarray, meaning: Any
) -> None:
    rows = np.tile(home if meaning == "positions" else np.zeros(7), (LENGTH, 1))
    widths = 0.001 * np.arange(LENGTH)

    class Grasping:
        def infer(self, observation: Mapping[str, Any]) -> dict[str, Any]:
            return {"actions": np.column_stack([rows, widths, np.full(LENGTH, np.nan)])}

    hand = Hand(simulation)
    runner = PolicyRunner(
        simulation.robot, control, Grasping(), PERIOD_S, meaning=meaning, fingers=hand, clock=simulation.clock
    )
    runner.run(0.3)
    assert len(runner.sent) == 1
    assert runner.sent[0].widths.tolist() == widths[runner.sent[0].dropped :].tolist()
    assert len(hand.aims) > 20
    for now_s, width in hand.aims:
        due = int((now_s - runner.sent[0].observed_s) / PERIOD_S + 1e-9) - 1
        assert width == widths[due]
    assert simulation.robot.states().q == pytest.approx(home, abs=5e-3)


def test_a_policy_without_the_column_of_the_fingers_ends_with_a_sentence(
    simulation: Simulation, control: JointImpedanceControl, home: np.ndarray
) -> None:
    class JointsAlone:
        def infer(self, observation: Mapping[str, Any]) -> dict[str, Any]:
            return {"actions": np.tile(home, (LENGTH, 1))}

    runner = PolicyRunner(
        simulation.robot,
        control,
        JointsAlone(),
        PERIOD_S,
        fingers=Hand(simulation),
        clock=simulation.clock,
    )
    with pytest.raises(ExecutionError, match=r"have shape \(15, 7\); a chunk for this arm is \(k, 8\)"):
        runner.run(1.0)


def test_the_observed_state_has_the_width_of_a_gripper() -> None:
    reading = GripperReading(0.04, 0.03, float("nan"), moving=False, object=GripperObject.NONE)
    state = JointState([0.1, 0.2], [0, 0], [0, 0], [0, 0], [0] * 7, reading)
    assert state_observer()(state)["observation/state"] == pytest.approx([0.1, 0.2, 0.04])
    unknown = replace(state, gripper=replace(reading, width=float("nan")))
    assert state_observer()(unknown)["observation/state"] == pytest.approx([0.1, 0.2, 0.0])


def test_a_policy_that_is_always_too_late_ends_with_a_sentence(
    simulation: Simulation, control: JointImpedanceControl, home: np.ndarray
) -> None:
    policy = Swing(simulation, home, 0.6)
    runner = PolicyRunner(simulation.robot, control, policy, PERIOD_S, clock=simulation.clock)
    with pytest.raises(ExecutionError, match=f"takes 0.6.. s for {LENGTH} actions of .* s; {PATIENCE} "):
        runner.run(10.0)
    assert runner.sent == []


def test_a_stop_ends_the_run(
    simulation: Simulation, control: JointImpedanceControl, home: np.ndarray
) -> None:
    class Pressed(Swing):
        def infer(self, observation: Mapping[str, Any]) -> dict[str, Any]:
            if len(self.asked) == 3:
                control.trigger_estop()
                self.simulation.clock.sleep(0.01)
            return super().infer(observation)

    runner = PolicyRunner(
        simulation.robot, control, Pressed(simulation, home), PERIOD_S, clock=simulation.clock, every_s=0.1
    )
    with pytest.raises(MotionStopped, match="session has ended"):
        runner.run(5.0)
    simulation.clock.sleep(1.0)
    assert np.abs(simulation.robot.states().dq).max() < 1e-3


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ({}, "has no 'actions'; it has nothing"),
        ({"action": 1}, "has no 'actions'; it has action"),
        ({"actions": "left"}, "are not numbers"),
        ({"actions": [[0.0] * 6]}, r"have shape \(1, 6\); a chunk for this arm is \(k, 7\)"),
        ({"actions": np.zeros((0, 7))}, "with k at least 1"),
        ({"actions": [[0.0] * 7, [0.0] * 6 + [float("nan")]]}, "action 1 is not a finite number for joint 7"),
    ],
)
def test_an_answer_that_is_no_chunk_is_named(answer: dict[str, Any], said: str) -> None:
    with pytest.raises(ExecutionError, match=said):
        actions_of(answer, 7)


def test_actions_that_are_past_are_left_out() -> None:
    times_s, points = timed(np.arange(10.0)[:, None], 5.0, 0.1, 5.25, "positions", np.zeros(1))
    assert times_s == pytest.approx(5.0 + 0.1 * np.arange(3, 11))
    assert points[:, 0].tolist() == list(range(2, 10))


def test_the_expected_latency_is_the_worst_of_late() -> None:
    latency = Latency(kept=2)
    assert latency.expected_s == latency.last_s == 0.0
    for taken_s in (0.5, 0.1, 0.2):
        latency.add(taken_s)
    assert (latency.last_s, latency.expected_s) == (0.2, 0.2)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"period_s": 0.0}, "period_s must be from 0.002 to 1 s"),
        ({"meaning": "forces"}, "meaning must be positions or offsets"),
        ({"every_s": 0.0}, "every_s must be above 0"),
    ],
)
def test_wrong_options_of_a_run_are_named(
    simulation: Simulation, control: JointImpedanceControl, options: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        PolicyRunner(
            simulation.robot, control, Swing(simulation, np.zeros(7)), **{"period_s": PERIOD_S, **options}
        )


def test_the_published_server_moves_the_arm(
    simulation: Simulation, control: JointImpedanceControl, home: np.ndarray
) -> None:
    pytest.importorskip("msgpack", reason="msgpack is not installed: pip install 'cobot[learning]'")
    server = pytest.importorskip("openpi_server", reason="openpi-server is not installed")
    from websockets.asyncio.server import serve

    from cobot.learning.openpi import PolicyConnection

    made = server.WebsocketPolicyServer(Swing(simulation, home), metadata={"model": "swing"})

    async def begin() -> Any:
        return await serve(made._handler, "127.0.0.1", 0, compression=None, max_size=None)

    with in_a_loop(begin) as (loop, running):
        address = f"127.0.0.1:{running.sockets[0].getsockname()[1]}"
        with PolicyConnection(address) as policy:
            assert policy.metadata == {"model": "swing"}
            PolicyRunner(simulation.robot, control, policy, PERIOD_S, clock=simulation.clock).run(2.0)
        moved = simulation.robot.states().q[0] - home[0]
        assert moved > 0.1

        async def end() -> None:
            running.close()
            await asyncio.wait_for(running.wait_closed(), WAIT_S)

        asyncio.run_coroutine_threadsafe(end(), loop).result(WAIT_S)
