"""`cobot fleet list`, `show` and `watch`: they show the data that the hub has about the cells."""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import Any
from urllib.parse import quote

from cobot.errors import InputError, UnavailableError
from cobot.fleet.asking import ask, get
from cobot.foreign import plain_lines, plain_text

PICTURE_S = 40.0
WATCH_S = 0.5
MAX_CELL = 48
"""Maximum number of characters in a column of the list. `show` prints the whole text."""
MAX_LINE = 4000
COLUMNS = ("cell", "robot", "state", "mode", "job", "program", "control", "version")
EXIT_OK = 0


def list_robots(chosen: argparse.Namespace) -> int:
    answer = ask(chosen, "GET", "/cells")
    if chosen.json:
        print(json.dumps(answer, indent=1))
        return EXIT_OK
    rows: list[tuple[str, ...]] = [COLUMNS]
    rows += [tuple(plain_text(robot[name], MAX_CELL) for name in COLUMNS) for robot in answer["robots"]]
    widths = [max(len(row[index]) for row in rows) for index in range(len(COLUMNS))]
    for row in rows:
        print("  ".join(each.ljust(width) for each, width in zip(row, widths, strict=True)).rstrip())
    for robot in answer["robots"]:
        for line in _concerns(robot):
            tell(f"{robot['cell']}/{robot['robot']}: {line}")
    return EXIT_OK


def tell(line: str) -> None:
    """Print a line that contains text from cells. This text can neither move the cursor nor look like another
    line.
    """
    print(plain_text(line, MAX_LINE), flush=True)


def _concerns(robot: dict[str, Any]) -> list[str]:
    said = [f"gone, last heard {robot['age_s']:.0f} s ago"] if not robot["alive"] else []
    said += ["two cells use this name: give each its own fleet.cell"] if robot["used_twice"] else []
    said += [robot["reason"]] if robot["reason"] and robot["state"] in ("estop", "fault", "silent") else []
    said += [f"changed since the roll-out: {', '.join(robot['drift'])}"] if robot["drift"] else []
    return said + list(robot["problems"])


def show(chosen: argparse.Namespace) -> int:
    path = f"/cells/{quote(chosen.cell, safe='')}"
    answer = ask(chosen, "GET", path) | ask(chosen, "GET", f"{path}/events")
    if chosen.picture:
        _write_picture(chosen, [str(each["robot"]) for each in answer["robots"]])
    if chosen.json:
        print(json.dumps(answer, indent=1))
        return EXIT_OK
    for robot in answer["robots"]:
        for name, value in robot.items():
            if isinstance(value, dict):
                value = [f"{each} {count}" for each, count in value.items()]
            if value not in ("", [], None):
                tell(f"{name:16} {', '.join(value) if isinstance(value, list) else value}")
        print()
    for event in answer["events"]:
        tell(f"{event['time'][:23]}  {event['robot']}  {event['type']}  {json.dumps(event['data'])}")
    return EXIT_OK


def _write_picture(chosen: argparse.Namespace, robots: list[str]) -> None:
    """Write a picture of a robot to a file.

    Raises:
        InputError: the cell has several robots, or the file cannot be written.
        UnavailableError: the hub or the cell does not answer.
    """
    if len(robots) > 1:
        raise InputError(
            f"{chosen.cell} has several robots: {', '.join(robots)}; the page shows each of them"
        )
    path = f"/cells/{quote(chosen.cell, safe='')}/robots/{quote(robots[0], safe='')}/picture"
    content = get(chosen, "GET", path, timeout_s=PICTURE_S).content
    try:
        chosen.picture.write_bytes(content)
    except OSError as exc:
        raise InputError(f"{chosen.picture}: cannot be written: {exc.strerror}") from exc


def watch(chosen: argparse.Namespace) -> int:
    seen: dict[tuple[str, str], str] = {}
    robots: list[dict[str, Any]] = ask(chosen, "GET", "/cells")["robots"]
    while True:
        for robot in robots:
            name = robot["cell"], robot["robot"]
            line = "  ".join(filter(None, (robot["state"], robot["job"], robot["program"], *_said(robot))))
            if seen.get(name) != line:
                seen[name] = line
                if chosen.json:
                    print(json.dumps(robot), flush=True)
                else:
                    tell(f"{time.strftime('%H:%M:%S')}  {'/'.join(name)}  {line}")
        time.sleep(WATCH_S)
        robots = _robots_again(chosen)


def _robots_again(chosen: argparse.Namespace) -> list[dict[str, Any]]:
    """All robots that the hub knows. If the hub does not answer, for example during a restart, it is asked
    again.
    """
    problem = ""
    while True:
        try:
            return list(ask(chosen, "GET", "/cells")["robots"])
        except UnavailableError as exc:
            if not problem:
                problem = str(exc)
                print(f"cobot: {plain_lines(exc)}", file=sys.stderr, flush=True)
            time.sleep(WATCH_S)


def _said(robot: dict[str, Any]) -> list[str]:
    """The problems of a robot. The age of its last report is left out, because the age changes all the
    time.
    """
    return _concerns(robot | {"age_s": 0.0})[0 if robot["alive"] else 1 :]
