"""Output of the commands for people: tables, and a progress bar while the arm moves."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from cobot.client import Client
from cobot.client.connection import Json
from cobot.errors import CobotError

STATE_HZ = 10.0
WARNINGS = ("log", "stop", "refused", "intervention")
PROGRAM, CONTINUED = "program: ", "    | "
"""Prefix of the first line of a program's output, and of each further line of the same output."""
MISSING = "(lines may be missing here: more were printed at once than the service stores)"
LEVELS = {"fault": "bold red", "estop": "bold red", "lost": "magenta"} | dict.fromkeys(WARNINGS, "yellow")


def said(answer: object) -> None:
    """Print JSON, one document per line."""
    print(json.dumps(answer), flush=True)


def show_state(health: Json, joints: Json, pose: Json, control: Json, io: list[Json]) -> None:
    console = Console(highlight=False)
    robot = health["robot"]
    head = Text(f"{robot['name']}: {robot['mode']}", style="bold")
    if robot["reason"]:
        head.append(f" ({robot['reason']})", style="")
    console.print(head)
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("joint")
    for name in ("position, rad", "velocity, rad/s", "effort, N·m"):
        table.add_column(name, justify="right")
    for row in zip(joints["name"], joints["position"], joints["velocity"], joints["effort"], strict=True):
        table.add_row(row[0], f"{row[1]:.4f}", f"{row[2]:.4f}", f"{row[3]:.2f}")
    console.print(table)
    where, turn = pose["position"], pose["orientation"]["euler_rad"]
    metres = " ".join(f"{axis} {where[axis]:.4f}" for axis in "xyz")
    angles = " ".join(f"{axis} {turn[axis]:.4f}" for axis in "abc")
    console.print(Text(f"TCP in {pose['frame_id']}: {metres} m, {angles} rad"))
    console.print(Text(f"control: {control['holder'] or control['what'] or 'free'}"))
    for each in io:
        console.print(Text(f"{each['direction']} {each['name']}: {_shown(each['value'])}"))
    for problem in health["problems"]:
        console.print(Text(f"problem: {problem}", style="red"))


def show_table(rows: list[Json], columns: dict[str, str]) -> None:
    """Print a table.

    Args:
        columns: heading by the name of the value.
    """
    table = Table(box=None, header_style="bold", pad_edge=False)
    for heading in columns.values():
        table.add_column(heading)
    for row in rows:
        table.add_row(*(Text(_shown(row.get(name))) for name in columns))
    Console(highlight=False).print(table)


def event_line(event: Json) -> Text:
    """Format an event as one line. Empty fields are left out."""
    told = {name: value for name, value in event["data"].items() if value not in (None, "")}
    data = " ".join(f"{name}={_shown(value)}" for name, value in told.items())
    moment = str(event["time"])[11:23]
    return Text(
        f"{moment} {event['robot'] or '-'} {event['type']} {data}", style=LEVELS.get(event["type"], "")
    )


def show_words(before: list[str], now: list[str]) -> None:
    """Print the new output of a program, by comparing two readings of `/sequences/logs`."""
    gone = next(gone for gone in range(len(before) + 1) if before[gone:] == now[: len(before) - gone])
    if before and gone == len(before):
        print(MISSING, flush=True)
    from_program = False
    for place, line in enumerate(now):
        if line.startswith(CONTINUED):
            text = line.removeprefix(CONTINUED)
        else:
            _, _, text = line.partition(" ")  # the newest lines are not read yet
            from_program = text.startswith(PROGRAM)
        if from_program and place >= len(before) - gone:
            print(text.removeprefix(PROGRAM), flush=True)


class Bar:
    """Progress of the arm on stderr. Prints nothing if stderr is not a terminal, or with --json."""

    def __init__(self, shown: bool) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            disable=not (shown and sys.stderr.isatty()),
            transient=True,
            redirect_stdout=sys.stdout.isatty(),  # to the same screen, above the bar
        )
        self._task: TaskID | None = None

    @contextmanager
    def showing(self, what: str) -> Iterator[Bar]:
        with self._progress:
            self._task = self._progress.add_task(what, total=None)
            yield self

    def update(self, done: float, total: float, what: str | None = None) -> None:
        if self._task is not None:
            self._progress.update(self._task, completed=done, total=total, description=what)


def during(client: Client, work: Callable[[], Json], bar: Bar) -> Json:
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
    """Show the bar. Without events or a terminal there is no bar."""
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
    return "" if value is None else str(value)
