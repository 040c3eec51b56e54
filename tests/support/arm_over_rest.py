"""Requests about an arm that any test of a simulated controller needs."""

from __future__ import annotations

from typing import Any

import httpx
from arm_activities import robot_health
from cobot_run import WAIT_S, Run, again


def device(run: Run) -> dict[str, Any]:
    """The device of the only robot, as GET /robots reports it."""

    def asked() -> Any:
        answer = httpx.get(f"{run.url}/robots", timeout=WAIT_S)
        return answer.json() if answer.status_code == 200 else None

    (shown,) = run.until(asked)
    found: dict[str, Any] = shown["device"]
    return found


def acknowledge(run: Run) -> None:
    """Acknowledge the first contact, unless an earlier run has."""
    if device(run)["unacknowledged"]:
        checked = {"payload_checked": True}
        httpx.post(f"{run.url}/robot/acknowledge", json=checked, timeout=WAIT_S).raise_for_status()


def reset_until_ready(run: Run, *, at_least_once: bool = True) -> None:
    """Reset the arm as often as it takes, as its user would after a fault."""
    said: list[str] = []

    def reset() -> bool:
        if not at_least_once and robot_health(run).get("mode") == "HOLD":
            return True
        said.append(httpx.post(f"{run.url}/robot/reset", timeout=WAIT_S).text)
        return robot_health(run).get("mode") == "HOLD"

    try:
        run.until(reset)
    except AssertionError as exc:
        raise AssertionError(f"{sorted(set(said))}, {robot_health(run)}; {exc}") from exc


def move(run: Run, kind: str, **body: object) -> None:
    """Move the arm, again if the computer was late."""

    def asked() -> tuple[bool, str]:
        answer = httpx.post(f"{run.url}/robot/move/{kind}", json={"speed": 1.0, **body}, timeout=WAIT_S)
        return bool(answer.json().get("success")), answer.text

    again(asked)
