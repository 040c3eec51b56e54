"""`make bench`: measures cobot against peers and floors in the same run, and prints one table.

python -m benchmarks [--quick | --full] [NAME ...]
python -m benchmarks stress [--quick] [--arm NAME]  random requests of every planner, each answer judged
python -m benchmarks corpus [--only TEXT]           robot descriptions, from the file to motion
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable, Iterator

from benchmarks import corpus, request_path, studies
from benchmarks.backends import fanuc, franka, fri, rsi, ur
from benchmarks.handling import cell, contact, gripper, peg, signals
from benchmarks.loop import crowd, cycle, hot, idle, modes, recording, torn, virtual_clock
from benchmarks.planning import (
    around,
    budgets,
    clouds,
    clutter,
    corners,
    explanations,
    inverse,
    lines,
    plan_requests,
    planning_time,
    problem_sets,
    repeats,
    time_law,
    timed,
    verdicts,
)
from benchmarks.ros import dds, ros2_control, ros2_control_stream
from benchmarks.streams import latency, overshoot, policy, servo, smoothness, stopping
from benchmarks.stress import run as stress
from benchmarks.table import HEADER, Row
from benchmarks.web import answers, events, fleet, floods, looks, memory, pages, panel, preview, steady

BENCHMARKS: dict[str, Callable[[bool], Iterator[Row]]] = {
    "compute": lambda quick: cycle.compute(1 if quick else 5, 5.0 if quick else 12.0),
    "modes": lambda quick: modes.modes(1 if quick else 2, 3.0 if quick else 8.0),
    "hot": lambda quick: hot.hot(1 if quick else 5),
    "idle": lambda quick: idle.idle(5.0 if quick else 30.0),
    "recording": lambda quick: recording.recording(500 if quick else 5000, 5.0 if quick else 30.0),
    "crowd": lambda quick: crowd.crowd(20.0 if quick else 600.0),
    "cell_step": lambda quick: cell.step(2 if quick else 10, 2000),
    "cell_transports": lambda quick: cell.transports(10 if quick else 200),
    "wake_up": lambda quick: cycle.wake_up(2 if quick else 13, 5.0 if quick else 12.0),
    "latency": lambda quick: latency.commands(400 if quick else 3000, 2 if quick else 10),
    "servo": lambda quick: servo.servo(100 if quick else 1000, 5.0 if quick else 12.0),
    "dds": lambda quick: dds.dds(*(5.0, 200, 2000) if quick else (30.0, 2000, 100_000)),
    "torn_reads": lambda quick: torn.torn_reads(100_000 if quick else 10_000_000),
    "stops": lambda quick: stopping.stops(4 if quick else 40),
    "path_actions": lambda quick: signals.actions(1000 if quick else 10_000),
    "contact": lambda quick: contact.contact(40 if quick else 1000),
    "working": lambda quick: gripper.cycle(1 if quick else 5, 4.0 if quick else 10.0),
    "gripper": lambda quick: gripper.gripper(10 if quick else 200),
    "peg": lambda quick: peg.insertions(10 if quick else 100),
    "free_motions": lambda quick: contact.free_motions(20 if quick else 1000),
    "smoothness": lambda quick: smoothness.smoothness(6.0 if quick else 30.0),
    "overshoot": lambda quick: overshoot.overshoot(1 if quick else 4),
    "studies": lambda quick: studies.studies(1000 if quick else 8000, 20_000 if quick else 100_000),
    "fleet": lambda quick: fleet.fleet(*(20, 5.0, 5) if quick else (100, 20.0, 50)),
    "repeats": lambda quick: repeats.repeats(10 if quick else 100),
    "virtual_clock": lambda quick: virtual_clock.factor(2 if quick else 10),
    "inverse_kinematics": lambda quick: inverse.inverse_kinematics(300 if quick else 3000),
    "planning": lambda quick: planning_time.planning_time(30 if quick else 300),
    "corners": lambda quick: corners.corners(),
    "plan_requests": lambda quick: plan_requests.plan_requests(20 if quick else 100),
    "lines": lambda quick: lines.lines(40 if quick else 500),
    "explanations": lambda quick: explanations.explanations(40 if quick else 200),
    "clutter": lambda quick: clutter.clutter(*(6, 1, 0.2) if quick else (25, 6, 0.5)),
    "around": lambda quick: around.around(10 if quick else 100),
    "budgets": lambda quick: budgets.budgets(100 if quick else 20),
    "problem_sets": lambda quick: problem_sets.problem_sets(50 if quick else 10),
    "verdicts": lambda quick: verdicts.verdicts(100_000 if quick else 1_000_000),
    "clouds": lambda quick: clouds.clouds(100 if quick else 30),
    "durations": lambda quick: time_law.durations(20 if quick else 100),
    "straightness": lambda quick: planning_time.straightness(2 if quick else 12),
    "timed": lambda quick: timed.timed(5 if quick else 40),
    "documentation": lambda quick: pages.documentation(2 if quick else 7),
    "csv": lambda quick: pages.csv_upload(2 if quick else 7),
    "requests": lambda quick: answers.requests_per_second(2 if quick else 8, 2.0 if quick else 4.0),
    "request_path": lambda quick: request_path.passed(50 if quick else 300),
    "stop": lambda quick: answers.stop(10 if quick else 100),
    "events": lambda quick: events.events(*(5, 15.0) if quick else (60, 300.0)),
    "preview": lambda quick: preview.preview(5 if quick else 20),
    "panel": lambda quick: panel.panel(*(2, 5.0, 20.0) if quick else (20, 30.0, 600.0)),
    "looks": lambda quick: looks.looks(*(2, 5.0) if quick else (10, 20.0)),
    "fanuc": lambda quick: fanuc.fanuc(*(2000, 4, 1) if quick else (20_000, 20, 5)),
    "fri": lambda quick: fri.fri(*(2000, 4, 2) if quick else (20_000, 40, 10)),
    "rsi": lambda quick: rsi.rsi(*(2000, 4, 2) if quick else (100_000, 40, 10)),
    "ur": lambda quick: ur.ur(*(2000, 4, 2) if quick else (20_000, 20, 5)),
    "franka": lambda quick: franka.franka(2000 if quick else 20_000),
    "ros2_control": lambda quick: ros2_control.ros2_control(20 if quick else 100),
    "ros2_control_stream": ros2_control_stream.ros2_control_stream,
    "policy": lambda quick: policy.policy(*(100, 2) if quick else (1000, 10)),
    "floods": lambda quick: floods.floods(3 if quick else 40),
    "steady": lambda quick: steady.steady(60.0 if quick else 600.0),
    "memory": lambda quick: memory.memory(2.0 if quick else 10.0),
}

FULL: dict[str, Callable[[], Iterator[Row]]] = {
    "clutter": lambda: clutter.clutter(125, 3, 10.0),
    "fanuc": lambda: fanuc.fanuc(100_000, 100, 20),
    "fri": lambda: fri.fri(100_000, 100, 20),
    "ur": lambda: ur.ur(100_000, 100, 20),
    "steady": lambda: steady.steady(3600.0),
    "verdicts": lambda: verdicts.verdicts(10_000_000),
}
"""What --full does instead, where it does something else."""


def main() -> None:
    if sys.argv[1:2] == ["stress"]:
        sys.exit(stress.main(sys.argv[2:]))
    if sys.argv[1:2] == ["corpus"]:
        sys.exit(corpus.main(sys.argv[2:]))
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join(BENCHMARKS)}; all without one"
    )
    parser.add_argument("--quick", action="store_true", help="four minutes, not thirty: tails mean little")
    parser.add_argument(
        "--full",
        action="store_true",
        help="500 motions through clutter, 100,000 answers of FRI, memory over an hour: three hours more",
    )
    arguments = parser.parse_args()
    unknown = set(arguments.names) - set(BENCHMARKS)
    if unknown:
        parser.error(f"there is no {', '.join(sorted(unknown))}; valid names: {', '.join(BENCHMARKS)}")
    print(
        f"{os.cpu_count()} cores, Linux {platform.release()}, Python {platform.python_version()}\n\n{HEADER}",
        flush=True,
    )
    for name in arguments.names or BENCHMARKS:
        full = FULL.get(name) if arguments.full else None
        for row in full() if full else BENCHMARKS[name](arguments.quick):
            print(row, flush=True)


if __name__ == "__main__":
    main()
