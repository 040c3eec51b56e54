"""`cobot fleet`: the hub of a fleet, and commands that use it."""

from __future__ import annotations

import argparse
import getpass
import json
import logging
import os
import re
import signal
import socket
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from urllib.parse import quote

import httpx

from cobot.access.authentication import is_loopback
from cobot.addresses import CLIENT_NAME, check_url
from cobot.codes import ERROR_OF, Code
from cobot.errors import CobotError, ConfigError, InputError, UnavailableError
from cobot.fleet.hub import DEADLINE_S, REST_S
from cobot.foreign import plain_lines
from cobot.launch.fleet_extra import require_zenoh
from cobot.launch.process import in_words
from cobot.logs import start_logging

EXIT_OK, EXIT_FAILED, EXIT_USAGE, EXIT_INTERRUPTED = 0, 1, 2, 130
URL_VARIABLE = "COBOT_FLEET"
DEFAULT_URL = "http://127.0.0.1:8070"
TIMEOUT_S = 5.0
WATCH_S = 0.5
COLUMNS = ("cell", "robot", "state", "mode", "job", "program", "control", "version")
DESCRIPTION = """\
All cells of a plant in one place: docs/fleet.md.

  cobot fleet serve      run the hub: the cells connect to it, people open its page
  cobot fleet list       all robots with their states
  cobot fleet show CELL  all that the hub knows of a cell, and its last events
  cobot fleet watch      what changes, a line each
  cobot fleet stop CELL ...   stop the robots of these cells; --all stops all"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    if chosen.action is None:
        parser.print_help()
        return EXIT_USAGE
    if chosen.action == "stop" and bool(chosen.cells) == chosen.all:
        parser.error("stop: give the names of cells, or --all")
    try:
        return int(chosen.run(chosen))
    except CobotError as exc:
        print(f"cobot: {plain_lines(exc)}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "cobot fleet", description=DESCRIPTION, formatter_class=argparse.RawTextHelpFormatter
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION")
    serve = actions.add_parser("serve", help="run the hub until Ctrl-C")
    serve.add_argument(
        "--name", default="cobot", metavar="FLEET", help="of the fleet, as fleet.name of its cells"
    )
    serve.add_argument(
        "--listen",
        nargs="+",
        default=["tcp/127.0.0.1:7447"],
        metavar="tcp/HOST:PORT",
        help="where cells connect; default: tcp/127.0.0.1:7447",
    )
    serve.add_argument(
        "--connect",
        nargs="+",
        default=[],
        metavar="tcp/HOST:PORT",
        help="routers of Zenoh that the hub joins",
    )
    serve.add_argument("--host", default="127.0.0.1", metavar="H", help="of the page and the REST API")
    serve.add_argument("--port", type=int, default=8070, metavar="P", help="of them; 0 picks a free one")
    serve.set_defaults(run=_serve)
    url = argparse.ArgumentParser(add_help=False)
    url.add_argument(
        "--url",
        default=os.environ.get(URL_VARIABLE, DEFAULT_URL),
        metavar="URL",
        help=f"of the hub; default: {URL_VARIABLE}, or {DEFAULT_URL}",
    )
    url.add_argument("--json", action="store_true", help="print what the hub answers")
    listing = actions.add_parser("list", parents=[url], help="all robots with their states")
    listing.set_defaults(run=_list)
    show = actions.add_parser("show", parents=[url], help="one cell with its last events")
    show.add_argument("cell", metavar="CELL")
    show.set_defaults(run=_show)
    watch = actions.add_parser("watch", parents=[url], help="what changes, until Ctrl-C")
    watch.set_defaults(run=_watch)
    stop = actions.add_parser("stop", parents=[url], help="stop robots and wait until they are at rest")
    stop.add_argument("cells", nargs="*", metavar="CELL")
    stop.add_argument("--all", action="store_true", help="all cells of the fleet")
    stop.add_argument("--robot", metavar="NAME", help="only this robot of the cells")
    stop.add_argument(
        "--deadline", type=float, default=DEADLINE_S, metavar="S", help="in which the cells must receive it"
    )
    stop.set_defaults(run=_stop)
    return parser


def _serve(chosen: argparse.Namespace) -> int:
    import uvicorn

    from cobot.fleet.hub import Hub
    from cobot.fleet.web import make_app

    require_zenoh("cobot fleet serve")
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,48}", chosen.name):
        raise InputError(f"--name: {chosen.name!r} is not valid: 1 to 48 letters, digits, - and _")
    _require_loopback(chosen)
    listener = _listener(chosen.host, chosen.port)
    try:
        hub = Hub(chosen.name, chosen.listen, chosen.connect)
    except BaseException:
        listener.close()
        raise
    try:
        port = listener.getsockname()[1]
        host = f"[{chosen.host}]" if ":" in chosen.host else chosen.host
        print(
            f"fleet {chosen.name}: http://{host}:{port}; cells connect to {', '.join(chosen.listen)}",
            flush=True,
        )
        # uvicorn ends at these, and then raises them again, which would end this process before its session.
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: None)
        start_logging("fleet")  # errors of the start are for the terminal, as they are
        logging.getLogger("uvicorn").setLevel(logging.WARNING)
        app = make_app(hub, [chosen.host, host, "localhost", "127.0.0.1"])
        config = uvicorn.Config(app, log_config=None, access_log=False, timeout_graceful_shutdown=1)
        uvicorn.Server(config).run(sockets=[listener])
    finally:
        hub.close()
        listener.close()
    return EXIT_OK


def _require_loopback(chosen: argparse.Namespace) -> None:
    """
    Raises:
        ConfigError: another computer could reach the hub, which knows no tokens.
    """
    hosts = {"--host": [chosen.host], "--listen": [_host_of(each) for each in chosen.listen]}
    for option, names in hosts.items():
        for name in names:
            if name != "localhost" and not is_loopback(name):
                raise ConfigError(
                    f"{option}: {name} can be reached from other computers, and everybody there could stop "
                    "the cells and change what the page shows; use 127.0.0.1, and a tunnel such as `ssh -L` "
                    "from elsewhere"
                )


def _host_of(endpoint: str) -> str:
    found = re.fullmatch(r"tcp/(\[[0-9a-f:.]+\]|[^:/\[\]]+):([0-9]{1,5})", endpoint)
    if found is None or int(found[2]) > 65535:
        raise ConfigError(f"--listen: {endpoint!r} is not an address such as tcp/127.0.0.1:7447")
    return found[1].strip("[]")


def _listener(host: str, port: int) -> socket.socket:
    if not 0 <= port <= 65535:
        raise InputError(f"--port: is {port}, allowed is 0 to 65535; choose another port")
    try:
        return socket.create_server(
            (host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET, backlog=100
        )
    except OSError as exc:
        raise UnavailableError(f"--port: {host}:{port}: {exc.strerror or exc}; choose another port") from exc


def _list(chosen: argparse.Namespace) -> int:
    answer = _ask(chosen, "GET", "/cells")
    if chosen.json:
        print(json.dumps(answer, indent=1))
        return EXIT_OK
    rows = [COLUMNS, *(tuple(str(robot[name]) for name in COLUMNS) for robot in answer["robots"])]
    widths = [max(len(row[index]) for row in rows) for index in range(len(COLUMNS))]
    for row in rows:
        print("  ".join(each.ljust(width) for each, width in zip(row, widths, strict=True)).rstrip())
    for robot in answer["robots"]:
        for line in _concerns(robot):
            print(f"{robot['cell']}/{robot['robot']}: {line}")
    return EXIT_OK


def _concerns(robot: dict[str, Any]) -> list[str]:
    said = [f"gone, last heard {robot['age_s']:.0f} s ago"] if not robot["alive"] else []
    said += ["two cells use this name: give each its own fleet.cell"] if robot["used_twice"] else []
    said += [robot["reason"]] if robot["reason"] and robot["state"] in ("estop", "fault", "silent") else []
    return said + list(robot["problems"])


def _show(chosen: argparse.Namespace) -> int:
    path = f"/cells/{quote(chosen.cell, safe='')}"
    answer = _ask(chosen, "GET", path) | _ask(chosen, "GET", f"{path}/events")
    if chosen.json:
        print(json.dumps(answer, indent=1))
        return EXIT_OK
    for robot in answer["robots"]:
        for name, value in robot.items():
            if value not in ("", [], None):
                print(f"{name:16} {', '.join(value) if isinstance(value, list) else value}")
        print()
    for event in answer["events"]:
        print(f"{event['time'][:23]}  {event['robot']}  {event['type']}  {json.dumps(event['data'])}")
    return EXIT_OK


def _watch(chosen: argparse.Namespace) -> int:
    seen: dict[tuple[str, str], str] = {}
    while True:
        for robot in _ask(chosen, "GET", "/cells")["robots"]:
            name = robot["cell"], robot["robot"]
            line = "  ".join(filter(None, (robot["state"], robot["job"], robot["program"], *_said(robot))))
            if seen.get(name) != line:
                seen[name] = line
                text = (
                    json.dumps(robot)
                    if chosen.json
                    else f"{time.strftime('%H:%M:%S')}  {'/'.join(name)}  {line}"
                )
                print(text, flush=True)
        time.sleep(WATCH_S)


def _said(robot: dict[str, Any]) -> list[str]:
    """What is wrong, without ages, which always change."""
    return _concerns(robot | {"age_s": 0.0})[0 if robot["alive"] else 1 :]


def _stop(chosen: argparse.Namespace) -> int:
    below = f"/robots/{quote(chosen.robot, safe='')}" if chosen.robot else ""
    paths = (
        ["/stop"] if chosen.all else [f"/cells/{quote(cell, safe='')}{below}/stop" for cell in chosen.cells]
    )
    body = {"deadline_s": chosen.deadline}
    good, answers = True, []
    with ThreadPoolExecutor(max(1, len(paths))) as pool:  # no cell waits until another one has answered
        timeout_s = chosen.deadline + REST_S + TIMEOUT_S
        asked = [pool.submit(_ask, chosen, "POST", path, body, timeout_s) for path in paths]
    for each in asked:
        try:
            answers.append(each.result())
        except CobotError as exc:  # the other cells have been stopped nevertheless
            print(f"cobot: NOT stopped: {plain_lines(exc)}", file=sys.stderr)
            good = False
    if chosen.json:
        print(json.dumps(answers, indent=1))
    robots = [robot for answer in answers for robot in answer["robots"]]
    if not robots and good:
        print("cobot: NOT stopped: the hub knows no robots", file=sys.stderr)
        good = False
    for robot in [] if chosen.json else robots:
        concern = "" if robot["code"] == "ok" else "NOT stopped: "
        print(f"{robot['cell']}/{robot['robot']}: {concern}{robot['text']}")
    return EXIT_OK if good and all(answer["at_rest"] for answer in answers) else EXIT_FAILED


def _ask(
    chosen: argparse.Namespace, method: str, path: str, body: object = None, timeout_s: float = TIMEOUT_S
) -> dict[str, Any]:
    check_url(chosen.url)
    headers = {CLIENT_NAME: quote(_user(), safe="")}
    try:
        response = httpx.request(
            method, chosen.url.rstrip("/") + path, json=body, headers=headers, timeout=timeout_s
        )
        answer: dict[str, Any] = response.json()
    except (httpx.HTTPError, ValueError) as exc:
        reason = str(exc) or type(exc).__name__
        raise UnavailableError(
            f"the hub at {chosen.url} does not answer: {reason}; `cobot fleet serve` runs one, "
            f"{URL_VARIABLE} or --url names it"
        ) from exc
    if response.status_code != 200:
        code = str(answer.get("code", "error")).upper()
        kind = ERROR_OF.get(Code[code], CobotError) if code in Code.__members__ else CobotError
        raise kind(str(answer.get("detail", response.status_code)))
    return answer


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # no name for this number
        return str(os.getuid())


if __name__ == "__main__":
    sys.exit(in_words(main))
