"""Motions in the queue with actions, and the cycle in which each action has to fire."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from independent_models import second_robot
from wired_arm import WiredService

from cobot.types import Array

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
Json = dict[str, Any]


class Queue:
    """The queue of one robot, and the cycle in which each output was set.

    Attributes:
        fired: value of the output, and how many commands were written since the test began.
    """

    def __init__(self, run: WiredService) -> None:
        self.run, self.since = run, len(run.rig.commanded)
        self.fired: list[tuple[float, int]] = []

    @contextmanager
    def noting(self) -> Iterator[None]:
        """Note each output that is set."""
        arm, set_output = self.run.arm, self.run.arm.set_output

        def noted(name: str, value: float) -> None:
            set_output(name, value)
            self.fired.append((value, len(self.run.rig.commanded) - self.since))

        arm.set_output = noted  # type: ignore[method-assign]
        try:
            yield
        finally:
            arm.set_output = set_output  # type: ignore[method-assign]

    def vary_speed(self, random: np.random.Generator, changes: int) -> None:
        """Set random speeds at random times, among them pauses, and full speed in the end."""
        for _ in range(changes):
            self.run.sleep(float(random.uniform(0.01, 0.3)))
            fraction = float(random.choice([0.0, 0.1, 0.5, 1.0]))
            self.run.post("/robot/speed_override", {"fraction": fraction}).raise_for_status()
        self.run.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()

    def add(self, goal: list[float] | Json, radius_m: float = 0.0, path: str = "", **fields: Any) -> str:
        answer = self.ask(goal, radius_m, path, **fields)
        assert answer.status_code == 202, answer.text
        number: str = answer.json()["id"]
        return number

    def ask(self, goal: list[float] | Json, radius_m: float = 0.0, path: str = "", **fields: Any) -> Any:
        body = {"joints": goal, "speed": 0.3} if isinstance(goal, list) else goal
        path = path or ("/robot/move/pose" if "x" in body else "/robot/move/joints")
        return self.run.post(f"{path}?queue=true&blend_radius={radius_m}", body | fields)

    def job(self, number: str) -> Json:
        found: Json = self.run.get(f"/jobs/{number}").raise_for_status().json()
        return found

    def until(self, number: str, state: str = "finished") -> None:
        self.run.until(lambda: self.job(number)["state"] == state)

    def states(self, *numbers: str) -> list[str]:
        return [self.job(number)["state"] for number in numbers]

    def fates(self, number: str) -> list[bool | None]:
        return [each["fired"] for each in self.job(number)["actions"]]

    @property
    def values(self) -> list[float]:
        return [value for value, _ in self.fired]

    @property
    def commanded(self) -> Array:
        return np.array(self.run.rig.commanded[self.since :])

    def lengths_m(self) -> Array:
        """How long the path of the TCP is up to each command."""
        places = second_robot().path(self.commanded)[0]
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def rests(self) -> int:
        """How many cycles the arm stood still between its first and its last movement."""
        moves = np.flatnonzero(np.abs(np.diff(self.commanded, axis=0)).max(axis=1) > 1e-7)
        return int(moves[-1] - moves[0] + 1 - len(moves))


def setting(value: float, **at: Any) -> Json:
    return {"at": at, "set": {"output": "pressure", "value": value}}


def reached(lengths_m: Array, place_m: float) -> int:
    """The first command that is so far along the path."""
    return int(np.argmax(lengths_m >= place_m - 1e-7))
