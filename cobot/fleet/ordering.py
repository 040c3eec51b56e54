"""`cobot fleet stop`, `run` and the other commands that change something in the cells or in the hub."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from urllib.parse import quote

from cobot.errors import CobotError, ConflictError
from cobot.fleet.asking import TIMEOUT_S, ask
from cobot.fleet.looking import WATCH_S, tell
from cobot.fleet.messages import REST_S
from cobot.foreign import joined_text, plain_lines

EXIT_OK, EXIT_FAILED = 0, 1


def command(chosen: argparse.Namespace) -> int:
    """Send a command to all named targets at the same time.

    The function `chosen.action_of(chosen)` makes the command; None means a stop.
    """
    action: dict[str, Any] | None = chosen.action_of(chosen)
    last, refusal = ("stop", "NOT stopped") if action is None else ("commands", "not done")
    body = {"deadline_s": chosen.deadline} | ({} if action is None else {"action": action})
    good, answers = True, []
    paths = [f"{target}/{last}" for target in _targets(chosen)]
    with ThreadPoolExecutor(len(paths)) as pool:  # no cell waits for the answer of another cell
        timeout_s = chosen.deadline + REST_S + TIMEOUT_S
        asked = [pool.submit(ask, chosen, "POST", path, body, timeout_s) for path in paths]
    for each in asked:
        try:
            answers.append(each.result())
        except CobotError as exc:  # the other cells have received the command anyway
            print(f"cobot: {refusal}: {plain_lines(exc)}", file=sys.stderr)
            good = False
    if chosen.json:
        print(json.dumps(answers, indent=1))
    robots = [robot for answer in answers for robot in answer["robots"]]
    if not robots and good:
        print(f"cobot: {refusal}: the hub knows no robots", file=sys.stderr)
        good = False
    for robot in [] if chosen.json else robots:
        concern = "" if robot["code"] == "ok" else f"{refusal}: "
        tell(f"{robot['cell']}/{robot['robot']}: {concern}{joined_text(robot['text'])}")
    return EXIT_OK if good and all(robot["code"] == "ok" for robot in robots) else EXIT_FAILED


def _targets(chosen: argparse.Namespace) -> list[str]:
    """The URL paths of the targets of a command."""
    if chosen.all:
        return [""]
    if chosen.zone:
        return [f"/zones/{quote(chosen.zone, safe='')}"]
    below = f"/robots/{quote(chosen.robot, safe='')}" if chosen.robot else ""
    return [f"/cells/{quote(cell, safe='')}{below}" for cell in chosen.cells]


def roll_out(chosen: argparse.Namespace) -> int:
    """Roll out a bundle, and print the progress until the end. Ctrl-C rolls back."""
    from cobot.fleet.bundle import bundle_of

    content = bundle_of(chosen.folder, chosen.name or chosen.folder.resolve().name, chosen.version)
    bundle = ask(chosen, "POST", "/bundles", content)["bundle"]
    pairs = [each.partition("/") for each in chosen.cells]
    robots = [{"cell": cell, "robot": robot or "*"} for cell, _, robot in pairs]
    wish = {"bundle": bundle, "robots": robots, "wave": chosen.wave, "watch_s": chosen.watch}
    path = f"/roll-outs/{ask(chosen, 'POST', '/roll-outs', wish)['id']}"
    printed = 0
    while True:
        try:
            found = ask(chosen, "GET", path)
            for line in found["lines"][printed:]:
                if not chosen.json:
                    tell(line)
            printed = len(found["lines"])
            if found["state"] != "running":
                break
            time.sleep(WATCH_S)
        except KeyboardInterrupt:
            with contextlib.suppress(ConflictError):  # it has ended; the next answer contains the result
                ask(chosen, "POST", f"{path}/cancel")
    if chosen.json:
        print(json.dumps(found, indent=1))
    else:
        print(f"{found['title']}: {found['state'].replace('_', ' ')}")
    return EXIT_OK if found["state"] == "done" else EXIT_FAILED


def forget(chosen: argparse.Namespace) -> int:
    """Remove cells that are gone. If removing one of them fails, the others are still removed."""
    answers = []
    for cell in chosen.cells:
        try:
            answers.append(ask(chosen, "DELETE", f"/cells/{quote(cell, safe='')}"))
        except CobotError as exc:
            print(f"cobot: not removed: {plain_lines(exc)}", file=sys.stderr)
    if chosen.json:
        print(json.dumps(answers, indent=1))
    return EXIT_OK if len(answers) == len(chosen.cells) else EXIT_FAILED
