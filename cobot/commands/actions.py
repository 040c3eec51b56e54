"""The actions of the commands. Errors are reported with the service's messages."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from urllib.parse import quote

from cobot.client import Client
from cobot.client.connection import Json
from cobot.commands.completion import completion
from cobot.commands.options import url_of
from cobot.commands.screen import print_json, show_event, show_state, show_table, show_words, with_progress
from cobot.commands.terminal import Bar
from cobot.errors import CobotError, ExecutionError, InputError, UnavailableError
from cobot.foreign import plain_lines
from cobot.strict import shown

EXIT_OK, EXIT_FAILED, EXIT_UNAVAILABLE = 0, 1, 3
POLL_S = 0.1
LINES = 300
"""Maximum number of lines that the service returns at once from the log of sequences."""
JOBS = {
    "id": "job",
    "robot": "robot",
    "state": "state",
    "progress": "progress",
    "remaining_s": "remaining, s",
    "request": "request",
    "owner": "owner",
}

PROGRAMS = {
    "id": "program",
    "label": "name",
    "kind": "kind",
    "version": "version",
    "author": "author",
    "time": "saved",
}


def run(chosen: argparse.Namespace, parser: argparse.ArgumentParser) -> int:
    """Execute a command and return the exit status."""
    try:
        if chosen.command == "completion":
            print(completion(chosen.shell, parser), flush=True)
            return EXIT_OK
        if chosen.command == "teleop":
            from cobot.teleop.command import teleop

            teleop(chosen)
            return EXIT_OK
        with _client(chosen) as client:
            return ACTIONS[chosen.command](client, chosen)
    except CobotError as exc:
        if getattr(chosen, "json", False):
            print_json({"success": False, "code": exc.code, "message": str(exc)})
        print(f"cobot: {plain_lines(exc)}", file=sys.stderr)
        return EXIT_UNAVAILABLE if isinstance(exc, UnavailableError) else EXIT_FAILED


def _client(chosen: argparse.Namespace) -> Client:
    verify = True if chosen.certificate is None else chosen.certificate
    return Client(
        url_of(chosen), robot=chosen.robot, token=chosen.token, verify=verify, motion_timeout_s=86_400.0
    )


def _state(client: Client, chosen: argparse.Namespace) -> int:
    health, control = client.health(), client.who_controls()
    joints, pose, io = client.joint_states(), client.pose(), client.io()
    if chosen.json:
        print_json({"robot": health["robot"], "joints": joints, "pose": pose, "control": control, "io": io})
    else:
        show_state(health, joints, pose, control, io)
    return EXIT_OK


def _move(client: Client, chosen: argparse.Namespace) -> int:
    goal: list[str] = chosen.goal
    how: Json = {"speed": chosen.speed} | ({} if chosen.planner is None else {"planner": chosen.planner})
    how |= _fields(chosen.fields)
    move: Callable[..., Json]
    if goal[0] == "pose":
        numbers = _numbers(goal[1:])
        if len(numbers) not in (3, 6):
            raise InputError(f"pose: X Y Z, or X Y Z A B C; got {len(numbers)} numbers")
        where: Json = dict(zip("xyzabc", numbers, strict=False))
        move = client.move_pose
    elif len(goal) == 1 and not _is_number(goal[0]):
        where, move = {"name": goal[0]}, client.move_named
    else:
        where, move = {"joints": _numbers(goal)}, client.move_joints
    if chosen.queue:
        job = client.queue(where | how, blend_radius=chosen.blend_radius).read()
        _print_answer(chosen, job, f"job {job['id']} is {job['state']}")
        return EXIT_OK
    if chosen.blend_radius:
        raise InputError("--blend-radius: is only for moves in the queue; use it with --queue")
    with Bar(not chosen.json).showing("moving") as bar:
        answer = with_progress(client, partial(move, **where, **how), bar)
    ended = f"ended by its condition ({answer['stopped_by']})" if answer["stopped_by"] else "arrived"
    _print_answer(chosen, answer, f"{ended} after {answer['duration_s']:.2f} s")
    return EXIT_OK


def _fields(given: str) -> Json:
    """Parse the fields in the option `--fields`."""
    try:
        found = json.loads(given)
    except ValueError as exc:
        raise InputError(f"--fields: is not JSON: {exc}") from exc
    if not isinstance(found, dict):
        raise InputError(f"--fields: must be an object, got {shown(found)}")
    return found


def _send(client: Client, chosen: argparse.Namespace) -> int:
    path: Path = chosen.file
    content = _read(path)

    def send() -> Json:
        options: Json = {"move_to_start": True} if chosen.move_to_start else {}
        if path.suffix.lower() != ".json":
            sent = client.send_csv(path, **options)
        else:
            body = _trajectory(path, content)
            sent = client.send_trajectory(body.pop("points"), **body | options)
        return sent if chosen.no_wait else sent | _arrival(client, int(sent["motion_id"]))

    with Bar(not chosen.json).showing(path.name) as bar:
        answer = with_progress(client, send, bar)
    begun = f"motion {answer['motion_id']} has begun and takes {answer['duration_s']:.2f} s"
    _print_answer(
        chosen, answer, begun if chosen.no_wait else f"motion {answer['motion_id']} has reached its goal"
    )
    return EXIT_OK


def _arrival(client: Client, motion: int) -> Json:
    """Wait until a motion has ended.

    Raises:
        ExecutionError: the motion has not reached its goal.
    """
    while True:
        robot = client.health()["robot"]
        result = str(robot["motion_result"])
        if (
            robot["motion_id"] != motion or result == "ARRIVED"
        ):  # the next motion began after this one had reached its goal
            return {"result": "ARRIVED"}
        if result != "RUNNING":
            raise ExecutionError(
                f"motion {motion} has not reached its goal: {result.lower()}, {robot['reason']}"
            )
        time.sleep(POLL_S)


def _sequence(client: Client, chosen: argparse.Namespace) -> int:
    path: Path = chosen.sequence
    _read(path)
    bar = Bar(not chosen.json)

    def sequence() -> Json:
        before = client.sequence_logs(LINES)
        client.start_sequence(path, n_iterations=chosen.iterations, delay_between_iterations=chosen.delay)
        while True:
            status, now = client.sequence_status(), client.sequence_logs(LINES)
            if not chosen.json:
                bar.erase()
                show_words(before, now)
            if status["status"] != "running":
                return status
            if status["n_waypoints"]:
                place = f"{path.name} {status['iteration']}/{status['n_iterations']}"
                bar.update(status["waypoint"], status["n_waypoints"], place)
            before = now
            time.sleep(POLL_S)

    with bar.showing(path.name):
        status = with_progress(client, sequence, Bar(shown=False))
    if status["returncode"] != 0:
        lines = "; ".join(client.sequence_logs(3))
        raise ExecutionError(f"{path.name} ended with return code {status['returncode']}: {lines}")
    _print_answer(chosen, status, f"{path.name} is done")
    return EXIT_OK


def _stop(client: Client, chosen: argparse.Namespace) -> int:
    answer = client.stop(category=chosen.category)
    _print_answer(chosen, answer, str(answer["message"]))
    return EXIT_OK if answer["success"] else EXIT_FAILED


def _acknowledge(client: Client, chosen: argparse.Namespace) -> int:
    answer = client.acknowledge(payload_checked=chosen.payload_checked)
    _print_answer(chosen, answer, f"{answer['found']}\n{answer['message']}".strip())
    return EXIT_OK


def _jobs(client: Client, chosen: argparse.Namespace) -> int:
    change = next((what for what in ("cancel", "pause", "resume") if getattr(chosen, what)), None)
    if chosen.id is None:
        if change is not None:
            raise InputError(f"--{change}: needs the ID of a job")
        jobs = list(client._json("GET", "/jobs")["jobs"])
    elif change is not None:
        jobs = [client._json("POST", f"/jobs/{quote(chosen.id, safe='')}/{change}", timeout=15.0)]
    else:
        jobs = [client._json("GET", f"/jobs/{quote(chosen.id, safe='')}")]
    if chosen.json:
        print_json(jobs if chosen.id is None else jobs[0])
        return EXIT_OK
    show_table(jobs, JOBS)
    for job in jobs if chosen.id is not None else ():
        if job.get("error"):
            print(job["error"]["detail"])
    return EXIT_OK


def _program(client: Client, chosen: argparse.Namespace) -> int:
    if chosen.action == "list":
        found = client.programs()
        print_json(found) if chosen.json else show_table(found, PROGRAMS)
        return EXIT_OK
    if chosen.id is None:
        raise InputError(f"program {chosen.action}: needs the ID of a program")
    if chosen.action == "show":
        program = client.program(chosen.id, chosen.version)
        print_json(program) if chosen.json else print(program["text"])
        return EXIT_OK
    if chosen.action == "save":
        return _save_program(client, chosen)
    options = {} if chosen.version is None else {"version": chosen.version}
    answer = client.run_program(chosen.id, n_iterations=chosen.repeat, **options)
    _print_answer(chosen, answer, f"program {chosen.id} runs as sequence {answer['sequence_id']}")
    return EXIT_OK


def _save_program(client: Client, chosen: argparse.Namespace) -> int:
    if chosen.file is None:
        raise InputError("program save: needs the FILE after the ID")
    kind = "lua" if chosen.file.suffix == ".lua" else "sequence"
    try:
        text = _read(chosen.file).decode()
    except UnicodeDecodeError as exc:
        raise InputError(f"{chosen.file}: is not UTF-8 at byte {exc.start}") from exc
    label = chosen.label or chosen.id
    made = client.save_program(chosen.id, label, text, kind=kind, base=chosen.base)
    _print_answer(chosen, made, f"program {chosen.id} is saved as version {made['version']}")
    return EXIT_OK


def _watch(client: Client, chosen: argparse.Namespace) -> int:
    types = chosen.types.split(",") if chosen.types else ()
    for count, event in enumerate(client.events(types, state_hz=chosen.state_hz, after=chosen.after), 1):
        if chosen.json:
            print_json(event)
        else:
            show_event(event)
        if count == chosen.count:
            break
    return EXIT_OK


def _print_answer(chosen: argparse.Namespace, answer: Json, sentence: str) -> None:
    if chosen.json:
        print_json(answer)
    else:
        note = answer.get("note")
        print(f"{sentence}: {note}" if note else sentence)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as exc:
        raise InputError(f"{path}: {exc.strerror}") from exc


def _trajectory(path: Path, content: bytes) -> Json:
    try:
        body = json.loads(content)
    except ValueError as exc:
        raise InputError(f"{path}: is not valid JSON: {exc}") from exc
    if isinstance(body, list):
        return {"points": body}
    if not isinstance(body, dict) or "points" not in body:
        raise InputError(f"{path}: is neither a list of points nor an object with `points`")
    return body


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(texts: list[str]) -> list[float]:
    for text in texts:
        if not _is_number(text):
            raise InputError(f"goal: {text!r} is not a number")
    return [float(text) for text in texts]


ACTIONS = {
    "state": _state,
    "move": _move,
    "send": _send,
    "run": _sequence,
    "stop": _stop,
    "jobs": _jobs,
    "program": _program,
    "watch": _watch,
    "acknowledge": _acknowledge,
}
