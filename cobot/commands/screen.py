"""Output that people read: state, jobs, events, and the progress of the arm."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from typing import Any

from cobot.client import Client
from cobot.client.connection import Json
from cobot.commands.terminal import Bar, show, show_columns
from cobot.errors import CobotError
from cobot.foreign import plain_text

STATE_HZ = 10.0
WARNINGS = ("log", "stop", "refused", "intervention")
PROGRAM, CONTINUED = "program: ", "    | "
"""Prefix of the first line of a program's output, and of each further line of the same output."""
MISSING = "(lines may be missing here: the program printed more at once than the service stores)"
LEVELS = {"fault": "bold red", "estop": "bold red", "lost": "magenta"} | dict.fromkeys(WARNINGS, "yellow")


def print_json(answer: object) -> None:
    """Print JSON, one document per line."""
    print(json.dumps(answer), flush=True)


def show_state(health: Json, joints: Json, pose: Json, control: Json, io: list[Json]) -> None:
    robot = health["robot"]
    reason = f" ({_shown(robot['reason'])})" if robot["reason"] else ""
    show(f"{robot['name']}: {robot['mode']}{reason}", "bold")
    columns = (joints["name"], joints["position"], joints["velocity"], joints["effort"])
    rows = [
        (name, f"{position:.4f}", f"{velocity:.4f}", f"{effort:.2f}")
        for name, position, velocity, effort in zip(*columns, strict=True)
    ]
    show_columns(("joint", "position, rad", "velocity, rad/s", "effort, N·m"), rows, right=1)
    where, turn = pose["position"], pose["orientation"]["euler_rad"]
    metres = " ".join(f"{axis} {where[axis]:.4f}" for axis in "xyz")
    angles = " ".join(f"{axis} {turn[axis]:.4f}" for axis in "abc")
    show(f"TCP in {pose['frame_id']}: {metres} m, {angles} rad")
    show(f"control: {_shown(control['holder'] or control['what'] or 'free')}")
    for each in io:
        show(f"{each['direction']} {each['name']}: {_shown(each['value'])}")
    for problem in health["problems"]:
        show(f"problem: {_shown(problem)}", "red")


def show_table(rows: list[Json], columns: dict[str, str]) -> None:
    """Print a table.

    Args:
        columns: the heading of each column, by the name of its value.
    """
    cells = [[_shown(row.get(name)) for name in columns] for row in rows]
    show_columns(list(columns.values()), cells, right=len(columns))


def show_event(event: Json) -> None:
    """Print an event as one line. Empty fields are omitted."""
    present = {name: value for name, value in event["data"].items() if value not in (None, "")}
    data = " ".join(f"{name}={_shown(value)}" for name, value in present.items())
    moment = str(event["time"])[11:23]
    show(f"{moment} {event['robot'] or '-'} {event['type']} {data}", LEVELS.get(event["type"], ""))


def show_words(before: list[str], now: list[str]) -> None:
    """Print the new output of a program. It is found by comparing two readings of `/sequences/logs`."""
    gone = next(gone for gone in range(len(before) + 1) if before[gone:] == now[: len(before) - gone])
    if before and gone == len(before):
        print(MISSING, flush=True)
    from_program = False
    for place, line in enumerate(now):
        if line.startswith(CONTINUED):
            text = line.removeprefix(CONTINUED)
        else:
            _, _, text = line.partition(" ")  # the newest lines have not been read yet
            from_program = text.startswith(PROGRAM)
        if from_program and place >= len(before) - gone:
            print(text.removeprefix(PROGRAM), flush=True)


def with_progress(client: Client, work: Callable[[], Json], bar: Bar) -> Json:
    """Show the progress of a motion and return its result. An interrupt stops the arm."""
    result: list[Json] = []
    failure: list[BaseException] = []
    ended = threading.Event()

    def run() -> None:
        try:
            result.append(work())
        except BaseException as exc:  # noqa: BLE001 - raised below
            failure.append(exc)
        ended.set()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        _follow(client, bar, ended)
        thread.join()
    except KeyboardInterrupt:
        client.stop()
        thread.join()
        raise
    if failure:
        raise failure[0]
    return result[0]


def _follow(client: Client, bar: Bar, ended: threading.Event) -> None:
    """Show the bar. If there are no events or no terminal, no bar is shown."""
    try:
        for event in client.events(["motion"], state_hz=STATE_HZ):
            if ended.is_set():
                return
            motion = event["data"].get("motion") if event["type"] == "state" else None
            if motion:
                bar.update(motion["path_time_s"], motion["duration_s"])
    except CobotError:
        while not ended.wait(0.2):
            pass


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict | list):
        return json.dumps(value)
    return "" if value is None else plain_text(value)
