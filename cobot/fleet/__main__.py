"""`cobot fleet`: the hub of a fleet, and commands that use it."""

from __future__ import annotations

import argparse
import getpass
import json
import os
import re
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx

from cobot.addresses import CLIENT_NAME, check_url
from cobot.client.tls import TOKEN_VARIABLE, advice, tls_context
from cobot.codes import ERROR_OF, Code
from cobot.errors import CobotError, InputError, UnavailableError
from cobot.fleet.messages import DEADLINE_S, REST_S
from cobot.fleet.serving import add_certificate, add_serve
from cobot.foreign import joined_text, plain_lines, plain_text
from cobot.launch.process import as_command

EXIT_OK, EXIT_FAILED, EXIT_USAGE = 0, 1, 2
URL_VARIABLE = "COBOT_FLEET"
DEFAULT_URL = "http://127.0.0.1:8070"
TIMEOUT_S = 5.0
PICTURE_S = 40.0
WATCH_S = 0.5
FILE_S = 30.0
PARTIAL, COMPLETE = 206, 416
"""HTTP status for the rest of a file, and for a file without a rest."""
MAX_CELL = 48
"""Maximum number of characters in a column of the list; `show` has the whole text."""
MAX_LINE = 4000
COLUMNS = ("cell", "robot", "state", "mode", "job", "program", "control", "version")
DESCRIPTION = """\
All cells of a plant in one place: docs/fleet.md.

  cobot fleet serve      run the hub: the cells connect to it, people open its page
  cobot fleet list       show all robots with their states
  cobot fleet show CELL  show everything that the hub knows about a cell, and its last events
  cobot fleet watch      print each change as a line
  cobot fleet stop CELL ...   stop the robots of these cells, of a zone (--zone Z), or of all cells (--all)
  cobot fleet run CELL ... --program ID   start a stored program of the cells
  cobot fleet pause|resume|speed|control CELL ...
  cobot fleet roll-out FOLDER CELL ...    install programs and settings: on one cell first, then in waves
  cobot fleet forget CELL ...    remove cells that are gone, for example after a change of their names
  cobot fleet pull FOLDER    copy recordings from the hub, which has fetched them from the cells
  cobot fleet certificate FOLDER hub|cell NAME ...   make certificates: TLS, and commands other than stops"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    if chosen.action is None:
        parser.print_help()
        return EXIT_USAGE
    if "zone" in chosen and sum(map(bool, (chosen.cells, chosen.all, chosen.zone))) != 1:
        parser.error(f"{chosen.action}: give the names of cells, --zone, or --all")
    try:
        return int(chosen.run(chosen))
    except CobotError as exc:
        print(f"cobot: {plain_lines(exc)}", file=sys.stderr)
        return EXIT_FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "cobot fleet", description=DESCRIPTION, formatter_class=argparse.RawTextHelpFormatter
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION")
    add_serve(actions)
    url = argparse.ArgumentParser(add_help=False)
    url.add_argument(
        "--url",
        default=os.environ.get(URL_VARIABLE, DEFAULT_URL),
        metavar="URL",
        help=f"URL of the hub; default: {URL_VARIABLE}, or {DEFAULT_URL}",
    )
    url.add_argument(
        "--token", default=os.environ.get(TOKEN_VARIABLE), help=f"access token; default: {TOKEN_VARIABLE}"
    )
    url.add_argument("--json", action="store_true", help="print the answers of the hub as JSON")
    listing = actions.add_parser("list", parents=[url], help="all robots with their states")
    listing.set_defaults(run=_list)
    show = actions.add_parser("show", parents=[url], help="one cell with its last events")
    show.add_argument("cell", metavar="CELL")
    show.add_argument("--picture", type=Path, metavar="FILE", help="also write a picture of the arm, as PNG")
    show.set_defaults(run=_show)
    watch = actions.add_parser("watch", parents=[url], help="print changes until Ctrl-C")
    watch.set_defaults(run=_watch)
    target = argparse.ArgumentParser(add_help=False, parents=[url])
    target.add_argument("cells", nargs="*", metavar="CELL")
    target.add_argument("--all", action="store_true", help="all cells of the fleet")
    target.add_argument("--zone", type=_name, help="all cells of this zone")
    target.add_argument("--robot", metavar="NAME", help="only this robot of the cells")
    target.add_argument(
        "--deadline",
        type=float,
        default=DEADLINE_S,
        metavar="S",
        help="time in which the cells must receive the command, s",
    )
    stop = actions.add_parser("stop", parents=[target], help="stop robots and wait until they are at rest")
    stop.set_defaults(run=_stop)
    run = actions.add_parser("run", parents=[target], help="start a stored program of the cells")
    run.add_argument("--program", required=True, metavar="ID")
    run.add_argument("--version", type=int, metavar="N", help="version of the program; default: the latest")
    run.set_defaults(run=_run)
    pause = actions.add_parser("pause", parents=[target], help="pause the running program")
    pause.set_defaults(run=_pause)
    resume = actions.add_parser("resume", parents=[target], help="resume the paused program or motion")
    resume.set_defaults(run=_resume)
    speed = actions.add_parser("speed", parents=[target], help="set the speed override")
    speed.add_argument(
        "--fraction", type=float, required=True, metavar="F", help="share of the planned speed, 0 to 1"
    )
    speed.set_defaults(run=_speed)
    control = actions.add_parser("control", parents=[target], help="take control, or give it back")
    which = control.add_mutually_exclusive_group(required=True)
    which.add_argument("--take", dest="what", action="store_const", const="take")
    which.add_argument("--release", dest="what", action="store_const", const="release")
    control.add_argument("--force", action="store_true", help="take control even if another client has it")
    control.set_defaults(run=_control)
    roll_out = actions.add_parser(
        "roll-out", parents=[url], help="install programs and settings: on one cell first, then in waves"
    )
    roll_out.add_argument(
        "folder", type=Path, metavar="FOLDER", help="with programs/, positions.json, settings/"
    )
    roll_out.add_argument("cells", nargs="+", metavar="CELL[/ROBOT]")
    roll_out.add_argument("--name", type=_name, help="name of the bundle; default: the folder's name")
    roll_out.add_argument("--version", required=True, metavar="V", help="version of the bundle, such as 1.4")
    roll_out.add_argument(
        "--wave", type=int, default=5, metavar="N", help="number of cells in a wave; default: 5"
    )
    roll_out.add_argument(
        "--watch",
        type=float,
        default=5.0,
        metavar="S",
        help="time to watch the robots after each wave, s; default: 5",
    )
    roll_out.set_defaults(run=_roll_out)
    forget = actions.add_parser("forget", parents=[url], help="remove cells that are gone")
    forget.add_argument("cells", nargs="+", metavar="CELL")
    forget.set_defaults(run=_forget)
    pull = actions.add_parser("pull", parents=[url], help="copy recordings from the hub to this computer")
    pull.add_argument("folder", type=Path, metavar="FOLDER")
    pull.add_argument("cells", nargs="*", metavar="CELL", help="default: all")
    pull.set_defaults(run=_pull)
    add_certificate(actions)
    return parser


def _name(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,48}", text):
        raise argparse.ArgumentTypeError(f"{text!r} is not valid: 1 to 48 letters, digits, - and _")
    return text


def _list(chosen: argparse.Namespace) -> int:
    answer = _ask(chosen, "GET", "/cells")
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
            _tell(f"{robot['cell']}/{robot['robot']}: {line}")
    return EXIT_OK


def _tell(line: str) -> None:
    """Print a line with texts of cells. They can neither move the cursor nor look like another line."""
    print(plain_text(line, MAX_LINE), flush=True)


def _concerns(robot: dict[str, Any]) -> list[str]:
    said = [f"gone, last heard {robot['age_s']:.0f} s ago"] if not robot["alive"] else []
    said += ["two cells use this name: give each its own fleet.cell"] if robot["used_twice"] else []
    said += [robot["reason"]] if robot["reason"] and robot["state"] in ("estop", "fault", "silent") else []
    said += [f"changed since the roll-out: {', '.join(robot['drift'])}"] if robot["drift"] else []
    return said + list(robot["problems"])


def _show(chosen: argparse.Namespace) -> int:
    path = f"/cells/{quote(chosen.cell, safe='')}"
    answer = _ask(chosen, "GET", path) | _ask(chosen, "GET", f"{path}/events")
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
                _tell(f"{name:16} {', '.join(value) if isinstance(value, list) else value}")
        print()
    for event in answer["events"]:
        _tell(f"{event['time'][:23]}  {event['robot']}  {event['type']}  {json.dumps(event['data'])}")
    return EXIT_OK


def _watch(chosen: argparse.Namespace) -> int:
    seen: dict[tuple[str, str], str] = {}
    robots: list[dict[str, Any]] = _ask(chosen, "GET", "/cells")["robots"]
    while True:
        for robot in robots:
            name = robot["cell"], robot["robot"]
            line = "  ".join(filter(None, (robot["state"], robot["job"], robot["program"], *_said(robot))))
            if seen.get(name) != line:
                seen[name] = line
                if chosen.json:
                    print(json.dumps(robot), flush=True)
                else:
                    _tell(f"{time.strftime('%H:%M:%S')}  {'/'.join(name)}  {line}")
        time.sleep(WATCH_S)
        robots = _robots_again(chosen)


def _robots_again(chosen: argparse.Namespace) -> list[dict[str, Any]]:
    """All robots, once the hub answers again if it is restarted."""
    problem = ""
    while True:
        try:
            return list(_ask(chosen, "GET", "/cells")["robots"])
        except UnavailableError as exc:
            if not problem:
                problem = str(exc)
                print(f"cobot: {plain_lines(exc)}", file=sys.stderr, flush=True)
            time.sleep(WATCH_S)


def _said(robot: dict[str, Any]) -> list[str]:
    """The problems of a robot, without ages, which always change."""
    return _concerns(robot | {"age_s": 0.0})[0 if robot["alive"] else 1 :]


def _stop(chosen: argparse.Namespace) -> int:
    return _command(chosen, None)


def _run(chosen: argparse.Namespace) -> int:
    version = {} if chosen.version is None else {"version": chosen.version}
    return _command(chosen, {"kind": "start", "program": chosen.program} | version)


def _pause(chosen: argparse.Namespace) -> int:
    return _command(chosen, {"kind": "pause"})


def _resume(chosen: argparse.Namespace) -> int:
    return _command(chosen, {"kind": "resume"})


def _speed(chosen: argparse.Namespace) -> int:
    return _command(chosen, {"kind": "speed", "fraction": chosen.fraction})


def _write_picture(chosen: argparse.Namespace, robots: list[str]) -> None:
    """
    Raises:
        InputError: the cell has several robots, or the file cannot be written.
        UnavailableError: the hub or the cell does not answer.
    """
    if len(robots) > 1:
        raise InputError(
            f"{chosen.cell} has several robots: {', '.join(robots)}; the page shows each of them"
        )
    path = f"/cells/{quote(chosen.cell, safe='')}/robots/{quote(robots[0], safe='')}/picture"
    content = _get(chosen, "GET", path, timeout_s=PICTURE_S).content
    try:
        chosen.picture.write_bytes(content)
    except OSError as exc:
        raise InputError(f"{chosen.picture}: cannot be written: {exc.strerror}") from exc


def _control(chosen: argparse.Namespace) -> int:
    if chosen.what == "take":
        return _command(chosen, {"kind": "take_control", "force": chosen.force})
    return _command(chosen, {"kind": "release_control"})


def _command(chosen: argparse.Namespace, action: dict[str, Any] | None) -> int:
    """Send a command to all named targets at the same time. Without an action it is a stop."""
    last, refusal = ("stop", "NOT stopped") if action is None else ("commands", "not done")
    body = {"deadline_s": chosen.deadline} | ({} if action is None else {"action": action})
    good, answers = True, []
    paths = [f"{target}/{last}" for target in _targets(chosen)]
    with ThreadPoolExecutor(len(paths)) as pool:  # no cell waits until another one has answered
        timeout_s = chosen.deadline + REST_S + TIMEOUT_S
        asked = [pool.submit(_ask, chosen, "POST", path, body, timeout_s) for path in paths]
    for each in asked:
        try:
            answers.append(each.result())
        except CobotError as exc:  # the other cells have the command nevertheless
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
        _tell(f"{robot['cell']}/{robot['robot']}: {concern}{joined_text(robot['text'])}")
    return EXIT_OK if good and all(robot["code"] == "ok" for robot in robots) else EXIT_FAILED


def _roll_out(chosen: argparse.Namespace) -> int:
    """Roll out a bundle, and print the progress until the end. Ctrl-C rolls back."""
    from cobot.fleet.bundle import bundle_of

    content = bundle_of(chosen.folder, chosen.name or chosen.folder.resolve().name, chosen.version)
    bundle = _ask(chosen, "POST", "/bundles", content)["bundle"]
    pairs = [each.partition("/") for each in chosen.cells]
    robots = [{"cell": cell, "robot": robot or "*"} for cell, _, robot in pairs]
    wish = {"bundle": bundle, "robots": robots, "wave": chosen.wave, "watch_s": chosen.watch}
    path = f"/roll-outs/{_ask(chosen, 'POST', '/roll-outs', wish)['id']}"
    printed = 0
    while True:
        try:
            found = _ask(chosen, "GET", path)
            for line in found["lines"][printed:]:
                if not chosen.json:
                    _tell(line)
            printed = len(found["lines"])
            if found["state"] != "running":
                break
            time.sleep(WATCH_S)
        except KeyboardInterrupt:
            _ask(chosen, "POST", f"{path}/cancel")
    if chosen.json:
        print(json.dumps(found, indent=1))
    else:
        print(f"{found['title']}: {found['state'].replace('_', ' ')}")
    return EXIT_OK if found["state"] == "done" else EXIT_FAILED


def _forget(chosen: argparse.Namespace) -> int:
    answers = [_ask(chosen, "DELETE", f"/cells/{quote(cell, safe='')}") for cell in chosen.cells]
    if chosen.json:
        print(json.dumps(answers, indent=1))
    return EXIT_OK


def _pull(chosen: argparse.Namespace) -> int:
    """Copy recordings that do not exist here yet. An interrupted copy continues where it ended."""
    found = _ask(chosen, "GET", "/recordings")["recordings"]
    known = {each["cell"] for each in [*found, *_ask(chosen, "GET", "/cells")["robots"]]}
    for cell in chosen.cells:
        if cell not in known:
            raise InputError(
                f"the hub knows no cell {cell!r}; it knows: {', '.join(sorted(known)) or 'none'}"
            )
    wanted = [each for each in found if not chosen.cells or each["cell"] in chosen.cells]
    new = []
    for each in wanted:
        names = [_plain(each[name]) for name in ("cell", "robot", "name")]
        file = chosen.folder.joinpath(*names)
        if not file.exists():
            _download(chosen, f"/recordings/{'/'.join(quote(name, safe='') for name in names)}", file)
            new.append("/".join(names))
            if not chosen.json:
                print(new[-1], flush=True)
    here = len(wanted) - len(new)
    print(
        json.dumps({"new": new, "already_here": here})
        if chosen.json
        else f"{len(new)} new, {here} already here"
    )
    return EXIT_OK


def _plain(name: str) -> str:
    """Check the name of a file or folder.

    Raises:
        InputError: the name would lead to another folder.
    """
    if not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]*", name):
        raise InputError(f"the hub's recording has an invalid name: {name!r}")
    return name


def _download(chosen: argparse.Namespace, path: str, file: Path) -> None:
    """
    Raises:
        UnavailableError: the hub does not answer. The next call continues.
        InputError: the file cannot be written.
    """
    part = file.with_name(f"{file.name}.part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(part, flags, 0o600), "ab") as out:
            headers = _headers(chosen) | {"Range": f"bytes={out.tell()}-"}
            url = chosen.url.rstrip("/") + path
            with httpx.stream(
                "GET", url, headers=headers, timeout=30.0, verify=tls_context(True)
            ) as response:
                if response.status_code == 416:  # it is complete
                    pass
                elif response.status_code != 206:
                    raise UnavailableError(f"{path}: the hub answers {response.status_code}")
                else:
                    for piece in response.iter_bytes():
                        out.write(piece)
        part.rename(file)
    except httpx.HTTPError as exc:
        raise UnavailableError(f"{path}: {str(exc) or type(exc).__name__}; the next call continues") from exc
    except OSError as exc:
        raise InputError(f"{file}: cannot be written: {exc.strerror}") from exc


def _headers(chosen: argparse.Namespace) -> dict[str, str]:
    token = {"Authorization": f"Bearer {chosen.token}"} if chosen.token else {}
    return {CLIENT_NAME: quote(_user(), safe="")} | token


def _targets(chosen: argparse.Namespace) -> list[str]:
    """The paths of the targets of a command."""
    if chosen.all:
        return [""]
    if chosen.zone:
        return [f"/zones/{quote(chosen.zone, safe='')}"]
    below = f"/robots/{quote(chosen.robot, safe='')}" if chosen.robot else ""
    return [f"/cells/{quote(cell, safe='')}{below}" for cell in chosen.cells]


def _ask(
    chosen: argparse.Namespace, method: str, path: str, body: object = None, timeout_s: float = TIMEOUT_S
) -> dict[str, Any]:
    return dict(_get(chosen, method, path, body, timeout_s).json())


def _get(
    chosen: argparse.Namespace, method: str, path: str, body: object = None, timeout_s: float = TIMEOUT_S
) -> httpx.Response:
    """The hub's answer.

    Raises:
        CobotError: the hub does not answer, or its error.
    """
    check_url(chosen.url)
    try:
        response = httpx.request(
            method,
            chosen.url.rstrip("/") + path,
            json=None if isinstance(body, bytes) else body,
            content=body if isinstance(body, bytes) else None,
            headers=_headers(chosen),
            timeout=timeout_s,
            verify=tls_context(True),
        )
        if response.status_code == 200:
            return response
        answer = dict(response.json())
    except (httpx.HTTPError, ValueError) as exc:
        reason = str(exc) or type(exc).__name__
        raise UnavailableError(
            f"the hub at {chosen.url} does not answer: {reason}{advice(exc)}; start it with "
            f"`cobot fleet serve`, or set its URL with {URL_VARIABLE} or --url"
        ) from exc
    code = str(answer.get("code", "error")).upper()
    kind = ERROR_OF.get(Code[code], CobotError) if code in Code.__members__ else CobotError
    raise kind(str(answer.get("detail", response.status_code)))


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # no name for this number
        return str(os.getuid())


if __name__ == "__main__":
    sys.exit(as_command(main))
