"""Trace: messages for the operator and the log."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from app.aubo.registry import Json, service
from app.services.devices.traces import Level, Message
from cobot.errors import InputError

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "Trace"
LEVELS = tuple(Level)


@service(CLASS)
def textmsg(robot: Services, msg: str) -> None:
    """Add a line to the messages and to the service's log.

    Args:
        msg: the text, up to 10000 characters.
    """
    robot.equipment.traces.add("text", msg)


@service(CLASS)
def notify(robot: Services, msg: str) -> None:
    """Add a notice.

    Args:
        msg: the text, up to 10000 characters.
    """
    robot.equipment.traces.add("notify", msg)


@service(CLASS)
def alarm(robot: Services, level: int, code: int, args: list[str]) -> None:
    """Add an alarm.

    Args:
        level: 0 info, 1 warning, 2 error, 3 fatal.
        code: number of the alarm, chosen by the sender.
        args: further details, joined with commas.
    """
    robot.equipment.traces.add("alarm", ", ".join(args), _level(level), code=code)


@service(CLASS)
def popup(robot: Services, level: int, title: str, msg: str, mode: int) -> None:
    """Add a message that a user interface should show as a dialogue.

    Args:
        level: 0 info, 1 warning, 2 error, 3 fatal.
        title: title, one line.
        msg: the text, up to 10000 characters.
        mode: 0, a message without an answer. Dialogues that wait for an answer are not supported.
    """
    if mode != 0:
        raise InputError(f"mode must be 0, got {mode}: dialogues that wait for an answer are not supported")
    robot.equipment.traces.add("popup", msg, _level(level), title=title)


@service(CLASS)
def peek(robot: Services, num: int, last_number: int = 0) -> Json:
    """Read the messages. The newest 1000 are kept.

    Args:
        num: the maximum number of messages; the newest are returned.
        last_number: only messages with a larger number are returned.

    Returns:
        a list of objects, the oldest first: number, time (ISO 8601, UTC), kind (text, notify, alarm, popup),
        level, code, title, text.
    """
    if num < 1:
        raise InputError(f"num must be at least 1, got {num}")
    return [_plain(message) for message in robot.equipment.traces.newest(num, last_number)]


def _level(level: int) -> Level:
    if level not in range(len(LEVELS)):
        valid = ", ".join(f"{number} {each}" for number, each in enumerate(LEVELS))
        raise InputError(f"there is no level {level}; valid values: {valid}")
    return LEVELS[level]


def _plain(message: Message) -> dict[str, object]:
    return {**asdict(message), "time": message.time.isoformat(timespec="milliseconds")}
