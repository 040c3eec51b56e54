"""Modes, commands, requests and faults, in the real cycle, stepped in robot time.

Oracles: the table of transitions, and numpy's finite differences of everything that was commanded.
"""

from __future__ import annotations

import numpy as np
import pytest
from rig import Rig

from cobot.config import Settings
from cobot.ipc.layout import RING, Command, Intervention, MotionResult
from cobot.motions.requests import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import LoopMode, PlannerName, Scaling
from rtloop.modes import TRANSITIONS

MOVE = np.array([0.6, 0.2, -0.3, 0.4, 0.2, -0.3, 0.5])


def motion(rig: Rig, by: np.ndarray = MOVE, speed: float = 0.5) -> Trajectory:
    here = rig.loop.controller.safety.position.copy()
    return plan_ptp(rig.robot, MotionRequest(here, here + by, PlannerName.PTP, Scaling(speed)), here + by)


def under_way(rig: Rig, cycles: int = 400) -> Trajectory:
    trajectory = motion(rig)
    assert rig.start(trajectory) == ""
    rig.step(cycles)
    assert rig.mode is LoopMode.TRAJECTORY
    return trajectory


def in_pieces(whole: Trajectory, pieces: int) -> Trajectory:
    times = np.linspace(0.0, whole.duration_s, pieces + 1)
    return from_hermite(times, *(whole.sample(times, derivative) for derivative in range(3)))


def within_limits(rig: Rig) -> None:
    velocity, acceleration, jerk = rig.rates()
    assert velocity.max() <= 1.001
    assert acceleration.max() <= 1.001
    assert jerk.max() <= 1.005


def test_modes_only_change_as_the_table_says(settings: Settings, robot: RobotDescription) -> None:
    random = np.random.default_rng(1)
    seen = set()
    for _ in range(6):
        rig = Rig(settings, robot)
        try:
            before = rig.mode
            for _ in range(60):
                what = random.choice(["start", "stop", "estop", "fault", "reset", "run"])
                if what == "start":
                    rig.memory.slots[0].write(1, motion(rig))
                    rig.send(Command.START, slot=0, motion_id=1)
                elif what == "fault":
                    rig.loopback.fail_read = "unplugged"
                elif what == "reset":
                    rig.loopback.fail_read = ""
                    rig.send(Command.RESET)
                elif what != "run":
                    rig.request(f"{what}s")
                for _ in range(int(random.integers(1, 120))):
                    rig.step()
                    if rig.mode is not before:
                        assert rig.mode in TRANSITIONS[before]
                        seen.add((before, rig.mode))
                        before = rig.mode
            within_limits(rig)
        finally:
            rig.close()
    assert len(seen) >= 7


def test_an_estop_stops_on_the_path_and_stays_until_reset(rig: Rig) -> None:
    trajectory = under_way(rig)
    rig.request("estops")
    rig.run()
    assert (rig.mode, rig.result, rig.reason) == (LoopMode.ESTOP, MotionResult.FAILED, "e-stop requested")
    on_path = trajectory.sample([rig.path_times[-1]])[0]
    np.testing.assert_allclose(rig.commanded[-1], on_path, atol=1e-12)
    assert "ESTOP" in rig.start(motion(rig))
    rig.request("stops")
    rig.step(10)
    assert rig.mode is LoopMode.ESTOP
    assert rig.answer(rig.send(Command.RESET)) == ""
    assert rig.mode is LoopMode.HOLD
    assert rig.start(motion(rig)) == ""
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    within_limits(rig)


def test_a_reset_has_to_wait_until_the_arm_is_at_rest(rig: Rig) -> None:
    under_way(rig)
    rig.request("estops")
    rig.step(2)
    assert "not at rest yet: it is slowing down on its path" in rig.answer(rig.send(Command.RESET))
    rig.run()
    assert rig.answer(rig.send(Command.RESET)) == ""


@pytest.mark.parametrize("kind", ["stops", "estops", "outside_stops", "outside_estops"])
def test_a_reset_that_a_stop_has_overtaken_is_refused(rig: Rig, kind: str) -> None:
    """The service revokes by a stop what rtloop has not answered in time: its client believes it failed."""
    rig.request("estops")
    rig.step(3)
    number = rig.send(Command.RESET)
    if kind.startswith("outside"):
        getattr(rig.memory, kind).add()
    else:
        rig.request(kind)
    assert rig.answer(number) == "a stop has been requested in the meantime"
    assert rig.mode is LoopMode.ESTOP


def test_a_stop_from_outside_of_the_service_ends_a_motion_on_its_path(rig: Rig) -> None:
    under_way(rig)
    rig.memory.outside_stops.add()
    rig.run()
    assert (rig.result, rig.reason) == (MotionResult.STOPPED, "stop requested")
    assert int(rig.memory.state.read()["stops_seen"]) == 1
    within_limits(rig)


def test_a_motion_that_a_stop_from_outside_has_overtaken_is_refused(rig: Rig) -> None:
    rig.memory.outside_stops.add()
    assert rig.start(motion(rig)) == "a stop has been requested in the meantime"
    assert rig.answer(rig.send(Command.START, stops=1, slot=0, motion_id=1)) == ""


def test_an_estop_from_outside_of_the_service_is_latched(rig: Rig) -> None:
    under_way(rig)
    rig.memory.outside_estops.add()
    rig.run()
    assert rig.mode is LoopMode.ESTOP
    assert rig.answer(rig.send(Command.RESET)) == ""


def test_a_motion_may_not_begin_while_the_arm_brakes(rig: Rig) -> None:
    """A motion that has failed to settle is over before the arm has come to rest."""
    by = np.zeros(7)
    by[0] = 2.9
    assert rig.start(motion(rig, by).stretched(0.02)) == "", "much too fast: the safety layer pursues it"
    while rig.mode is not LoopMode.HOLD:
        rig.step()
    assert rig.reason.startswith("the safety layer keeps joint1 at ")
    assert rig.loop.controller.moving
    assert rig.start(motion(rig, 0.01 * MOVE)) == "the arm is not at rest yet: its joints are slowing down"
    rig.run()
    assert rig.start(motion(rig, 0.01 * MOVE)) == ""


def test_a_reset_in_hold_changes_nothing(rig: Rig) -> None:
    assert rig.answer(rig.send(Command.RESET)) == ""
    assert rig.mode is LoopMode.HOLD


def test_a_reset_that_the_drives_refuse_leaves_the_fault(rig: Rig) -> None:
    rig.loopback.fail_read = "cable unplugged"
    rig.step()
    assert (rig.mode, rig.reason) == (LoopMode.FAULT, "reading from the robot failed: cable unplugged")
    rig.loopback.fail_enable = "brake not released"
    assert rig.answer(rig.send(Command.RESET)) == "the robot cannot be enabled: brake not released"
    assert rig.mode is LoopMode.FAULT
    rig.loopback.fail_read = rig.loopback.fail_enable = ""
    assert rig.answer(rig.send(Command.RESET)) == ""
    assert rig.mode is LoopMode.HOLD


@pytest.mark.parametrize("where", ["fail_read", "fail_write"])
def test_a_device_that_fails_during_a_motion_ends_it_on_the_path(rig: Rig, where: str) -> None:
    trajectory = under_way(rig)
    setattr(rig.loopback, where, "drive 3 overheated")
    rig.step(2)
    setattr(rig.loopback, where, "")
    rig.run()
    assert (rig.mode, rig.result) == (LoopMode.FAULT, MotionResult.FAILED)
    assert rig.reason.endswith("failed: drive 3 overheated")
    np.testing.assert_allclose(rig.commanded[-1], trajectory.sample([rig.path_times[-1]])[0], atol=1e-12)
    within_limits(rig)


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_a_measurement_that_is_no_number_is_a_fault_and_never_published(rig: Rig, poison: float) -> None:
    under_way(rig)
    rig.loopback.offset[3] = poison
    rig.step()
    rig.loopback.offset[3] = 0.0
    assert rig.mode is LoopMode.FAULT
    assert "not finite" in rig.reason
    assert np.isfinite(rig.memory.state.read()["position"]).all()
    rig.run()
    within_limits(rig)


def test_an_arm_that_is_pushed_off_its_path_is_a_fault_that_names_the_joint(rig: Rig) -> None:
    under_way(rig)
    rig.loopback.offset[4] = 1.1 * rig.settings.rt.tracking_error_rad
    rig.step()
    assert rig.mode is LoopMode.FAULT
    assert rig.reason.startswith("joint5 is ")
    assert rig.interventions[Intervention.TRACKING] == 1
    rig.run()
    within_limits(rig)


def test_an_arm_that_is_still_after_a_fault_is_at_rest_wherever_it_is(rig: Rig) -> None:
    """Who stops it waits for that; it will not come back to where it was commanded."""
    under_way(rig)
    rig.loopback.offset[4] = 1.1 * rig.settings.rt.tracking_error_rad
    rig.step()
    assert not rig.memory.state.read()["settled"]
    rig.run()
    rig.step(50)
    assert rig.memory.state.read()["settled"]


def test_after_a_fault_the_arm_is_held_where_it_is_now(rig: Rig) -> None:
    rig.loopback.offset[4] = 0.5  # pushed while the drives gave way
    rig.step(5)
    assert rig.mode is LoopMode.FAULT
    pushed = rig.memory.state.read()["position"].copy()
    assert rig.answer(rig.send(Command.RESET), cycles=2) == ""
    assert rig.mode is LoopMode.HOLD
    np.testing.assert_array_equal(rig.commanded[-1], pushed)


def test_a_silent_service_ends_the_motion(rig: Rig) -> None:
    under_way(rig)
    rig.beat(ahead_s=-0.1 - rig.settings.rt.service_timeout_s)
    rig.run()
    assert (rig.mode, rig.result) == (LoopMode.HOLD, MotionResult.STOPPED)
    assert "the service has been silent for" in rig.reason
    assert rig.interventions[Intervention.SERVICE_TIMEOUT] == 1
    within_limits(rig)


def test_many_late_cycles_in_a_row_stop_the_motion_and_few_do_not(rig: Rig) -> None:
    trajectory = under_way(rig)
    late_ns, many = 1_100_000, rig.settings.rt.overruns_to_stop
    for lateness in [*[late_ns] * (many - 1), 900_000, *[late_ns] * (many - 1)]:
        rig.step(late_ns=lateness)
    assert rig.mode is LoopMode.TRAJECTORY
    rig.step(late_ns=late_ns)
    assert rig.mode is LoopMode.STOPPING
    rig.run()
    assert (rig.mode, rig.result) == (LoopMode.HOLD, MotionResult.STOPPED)
    assert rig.reason == f"{many} cycles in a row began late: the computer is too slow or too busy"
    assert rig.interventions[Intervention.OVERRUN] == 1
    np.testing.assert_allclose(rig.commanded[-1], trajectory.sample([rig.path_times[-1]])[0], atol=1e-12)
    within_limits(rig)


def test_a_computer_that_is_late_all_the_time_lets_the_arm_hold_but_not_move(rig: Rig) -> None:
    late_ns, many = 5_000_000, rig.settings.rt.overruns_to_stop
    rig.step(3 * many, late_ns)
    assert (rig.mode, sum(rig.interventions)) == (LoopMode.HOLD, 0)
    rig.memory.slots[0].write(1, motion(rig))
    rig.send(Command.START, slot=0, motion_id=1)
    rig.step(many, late_ns)
    assert (rig.mode, rig.interventions[Intervention.OVERRUN]) == (LoopMode.STOPPING, 1)
    rig.run()
    assert rig.result is MotionResult.STOPPED


def test_a_motion_that_does_not_settle_has_failed(rig: Rig) -> None:
    assert rig.start(motion(rig)) == ""
    rig.loopback.offset[2] = 5 * rig.settings.rt.settle_position_rad
    rig.run()
    assert (rig.mode, rig.result) == (LoopMode.HOLD, MotionResult.FAILED)
    assert rig.reason.startswith("not settled 2.0 s after the end of the motion: joint3 is ")
    assert rig.reason.endswith("a load that is not declared can cause this (POST /robot/tool)"), "not cut off"


def test_settled_is_stated_only_after_the_settling_time(rig: Rig) -> None:
    assert rig.start(motion(rig)) == ""
    state = rig.memory.state
    ended = 0
    while not int(state.read()["settled"]):
        rig.step()
        ended += rig.path_times[-1] == rig.loop.controller.path.duration_s
    assert ended * rig.settings.rt.period_s >= rig.settings.rt.settle_time_s
    assert rig.result is MotionResult.ARRIVED


def test_a_pushed_arm_beyond_a_limit_is_held_and_may_move_back_only(rig: Rig) -> None:
    rig.loopback.offset[5] = rig.limits.max_position[5] + 0.01 - rig.home[5]
    rig.step()
    assert rig.mode is LoopMode.FAULT
    assert rig.answer(rig.send(Command.RESET), cycles=2) == ""
    rig.loopback.offset[5] = 0.0
    beyond = rig.commanded[-1].copy()
    rig.step(300)
    np.testing.assert_array_equal(rig.commanded[-1], beyond)
    out, back = np.zeros(7), np.zeros(7)
    out[5], back[5] = 0.005, -0.2
    assert "joint6 would be at" in rig.start(motion(rig, out))
    assert rig.start(motion(rig, back)) == ""
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    assert sum(rig.interventions) == 1, "the tracking error, and nothing since"


def test_while_the_robot_cannot_be_read_nothing_is_called_settled(rig: Rig) -> None:
    rig.step(100)
    assert rig.memory.state.read()["settled"]
    read_ns = int(rig.memory.state.data["measured_monotonic_ns"])
    rig.loopback.fail_read = "no answer"
    rig.step(3)
    state = rig.memory.state.read()
    assert not state["settled"]
    assert read_ns == state["measured_monotonic_ns"] < state["monotonic_ns"]


# what the service, or a wild writer, may leave in a slot


def test_a_trajectory_that_starts_elsewhere_is_refused(rig: Rig) -> None:
    off = motion(rig)
    coefficients = off.coefficients.copy()
    coefficients[:, 0, 0] += 0.01
    shifted = Trajectory(off.breakpoints_s, coefficients)
    assert rig.start(shifted) == (
        "the trajectory starts 0.0100 rad from the position of joint 1, allowed: 0.001 rad"
    )
    assert rig.mode is LoopMode.HOLD


def test_a_trajectory_beyond_a_joint_stop_is_refused(rig: Rig) -> None:
    """A stop ahead cannot be caught on the way, as velocities and accelerations can."""
    by = np.zeros(7)
    by[1] = 2.2
    answer = rig.start(motion(rig, by))
    assert answer.endswith("allowed: -2.1 to 2.1 rad")
    assert "s into the motion joint2 would be at 2." in answer


def test_a_trajectory_that_does_not_end_at_rest_is_refused(rig: Rig) -> None:
    whole = motion(rig)
    half = Trajectory(whole.breakpoints_s[:4], whole.coefficients[:3])
    assert rig.start(half) == "the trajectory is not at rest at its end"


def test_a_single_flipped_bit_is_found(rig: Rig) -> None:
    slot = rig.memory.slots[0]
    slot.write(1, motion(rig))
    slot.coefficients[2, 3, 4] = np.nextafter(slot.coefficients[2, 3, 4], 1.0)
    answer = rig.answer(rig.send(Command.START, slot=0, motion_id=1))
    assert answer == "the trajectory's checksum is wrong"


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_numbers_that_are_none_are_refused(rig: Rig, poison: float) -> None:
    slot = rig.memory.slots[1]
    slot.write(1, motion(rig))
    slot.coefficients[1, 2, 3] = poison
    assert "not finite" in rig.answer(rig.send(Command.START, slot=1, motion_id=1))


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"slot": 2}, "there is no slot 2"),
        ({"slot": 0, "motion_id": 9}, "the slot contains motion 1, not 9"),
        ({"kind": 77}, "there is no command 77"),
        ({"kind": Command.SET_RATE, "value": 0.5}, "no motion is running, the arm is in mode HOLD"),
    ],
)
def test_a_command_without_sense_is_refused(rig: Rig, fields: dict[str, float], reason: str) -> None:
    rig.memory.slots[0].write(1, motion(rig))
    kind = int(fields.pop("kind", Command.START))
    assert rig.answer(rig.send(kind, **{"motion_id": 1, **fields})) == reason
    assert rig.mode is LoopMode.HOLD


@pytest.mark.parametrize("segments", [0, 2001, 2**63])
def test_a_slot_with_an_impossible_number_of_segments_is_refused(rig: Rig, segments: int) -> None:
    slot = rig.memory.slots[0]
    slot.write(1, motion(rig))
    slot.head.data["segments"] = segments
    slot.head.publish()
    answer = rig.answer(rig.send(Command.START, slot=0, motion_id=1))
    assert answer == f"the trajectory has {segments} segments, allowed: 1 to 2000"


def test_random_bytes_in_every_block_that_the_service_writes_move_nothing(rig: Rig) -> None:
    random = np.random.default_rng(3)
    memory = rig.memory
    blocks = [memory.heartbeat, memory.requests, memory.head, *memory.commands]
    blocks += [slot.head for slot in memory.slots]
    for _ in range(300):
        block = blocks[random.integers(len(blocks))]
        block._shared[:] = random.bytes(len(block._shared))
        block._head[0] = int(random.integers(0, 2**64, dtype=np.uint64))
        rig.step(3)
    np.testing.assert_array_equal(rig.commanded[-1], rig.home)
    assert rig.memory.state.read()["torn_reads"] > 0


def test_a_stop_overtakes_a_start(rig: Rig) -> None:
    """The service has read the count of stops before it planned; a stop since then is for this motion too."""
    rig.memory.slots[0].write(1, motion(rig))
    rig.request("stops")
    command = rig.send(Command.START, slot=0, motion_id=1, stops=rig.memory.requests.data["stops"] - 1)
    assert rig.answer(command) == "a stop has been requested in the meantime"
    assert rig.mode is LoopMode.HOLD


def test_a_stop_while_a_long_motion_is_loaded_refuses_it(rig: Rig) -> None:
    rig.memory.slots[0].write(1, in_pieces(motion(rig), 1500))
    command = rig.send(Command.START, slot=0, motion_id=1)
    rig.step(3)
    rig.request("stops")
    assert rig.answer(command) == "stop requested"
    rig.step(2000)
    np.testing.assert_array_equal(rig.commanded[-1], rig.home)


def test_a_second_start_while_the_arm_moves_is_refused(rig: Rig) -> None:
    under_way(rig)
    rig.memory.slots[1].write(2, motion(rig))
    assert rig.answer(rig.send(Command.START, slot=1, motion_id=2)) == "the arm is in mode TRAJECTORY"
    rig.run()
    assert rig.result is MotionResult.ARRIVED


def test_a_flood_of_commands_is_answered_newest_last_and_moves_nothing(rig: Rig) -> None:
    numbers = [rig.send(99) for _ in range(10 * RING)]
    rig.step(2 * RING)
    assert rig.answer(numbers[-1]) == "there is no command 99"
    assert rig.mode is LoopMode.HOLD


# a new rtloop after one that died


def test_a_new_rtloop_fails_the_interrupted_motion_and_holds(
    rig: Rig, settings: Settings, robot: RobotDescription
) -> None:
    under_way(rig)
    where = rig.memory.state.read()["position"].copy()
    successor = Rig(settings, robot, memory=rig.memory, start=rig.home)
    assert (successor.mode, successor.result) == (LoopMode.HOLD, MotionResult.FAILED)
    assert successor.reason == "rtloop was restarted"
    successor.step(50)
    np.testing.assert_array_equal(successor.commanded[-1], where)


def test_a_new_rtloop_keeps_the_estop(rig: Rig, settings: Settings, robot: RobotDescription) -> None:
    rig.request("estops")
    rig.step(3)
    successor = Rig(settings, robot, memory=rig.memory)
    assert (successor.mode, successor.reason) == (LoopMode.ESTOP, "e-stop requested")
    assert "ESTOP" in successor.start(motion(successor))


def test_a_new_rtloop_does_not_repeat_commands_and_requests(
    rig: Rig, settings: Settings, robot: RobotDescription
) -> None:
    assert rig.start(motion(rig)) == ""
    rig.run()
    rig.request("stops")
    rig.step(2)
    successor = Rig(settings, robot, memory=rig.memory)
    successor.step(100)
    assert (successor.mode, successor.reason) == (LoopMode.HOLD, "")
    assert successor.loop.controller.commands.command_seen == 1


def test_a_new_rtloop_refuses_what_was_sent_to_the_dead_one(
    rig: Rig, settings: Settings, robot: RobotDescription
) -> None:
    rig.step(3)
    rig.memory.slots[0].write(1, motion(rig))
    number = rig.send(Command.START, slot=0, motion_id=1)
    successor = Rig(settings, robot, memory=rig.memory)
    assert successor.answer(number, cycles=1) == "rtloop was restarted"
    successor.step(100)
    assert successor.mode is LoopMode.HOLD
