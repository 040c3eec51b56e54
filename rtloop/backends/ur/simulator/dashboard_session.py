"""One client of a simulated controller's dashboard server. The answers are the ones that Universal Robots
documents.
"""

from __future__ import annotations

from rtloop.backends.ur.fields import RuntimeState, SafetyMode
from rtloop.backends.ur.simulator.controller import MOVING, UrController

MAX_LINE = 4096
GREETING = "Connected: Universal Robots Dashboard Server"
LOCAL = "Command is not allowed: the robot is in Local Control"
READING = (
    "robotmode", "safetymode", "safetystatus", "programstate", "running", "polyscopeversion", "version",
    "is in remote control", "get loaded program", "get robot model", "get serial number", "isprogramsaved",
    "get operational mode", "quit",
)  # fmt: skip
"""Commands that also work in Local Control."""


class DashboardSession:
    """A `UrSession` for a client of the dashboard server."""

    def __init__(self, controller: UrController) -> None:
        self._controller = controller
        self.out, self.is_over = bytearray(f"{GREETING}\n".encode()), False
        self._buffer = b""

    def feed(self, received: bytes) -> None:
        *lines, self._buffer = (self._buffer + received).split(b"\n")
        if len(self._buffer) > MAX_LINE:
            self.is_over = True
            return
        for line in lines:
            answer = self._answer(line.decode(errors="replace").strip())
            self.out += f"{answer}\n".encode()

    def tick(self) -> None:
        """Do nothing, because this session only answers requests."""

    def close(self) -> None:
        """Do nothing, because this session leaves nothing behind in the controller."""

    def _answer(self, line: str) -> str:
        controller, word = self._controller, line.lower()
        if not controller.is_remote and word not in READING:
            return LOCAL
        program = controller.program_name or "program"
        if word == "quit":
            self.is_over = True
        fixed = {
            "robotmode": lambda: f"Robotmode: {controller.robot_mode.name}",
            "safetymode": lambda: f"Safetymode: {controller.safety.name}",
            "safetystatus": lambda: f"Safetystatus: {controller.safety.name}",
            "programstate": lambda: f"{self._state()} {program}",
            "running": lambda: f"Program running: {str(controller.is_running).lower()}",
            "polyscopeversion": lambda: "URSoftware " + ".".join(map(str, controller.options.version)),
            "version": lambda: ".".join(map(str, controller.options.version)),
            "is in remote control": lambda: str(controller.is_remote).lower(),
            "get loaded program": lambda: "No program loaded",
            "get robot model": lambda: "UR5",
            "get serial number": lambda: "20200000000",
            "get operational mode": lambda: "NONE",
            "isprogramsaved": lambda: f"true {program}",
            "quit": lambda: "Disconnected",
            "power on": lambda: self._do(controller.power_on, "Powering on"),
            "power off": lambda: self._do(controller.power_off, "Powering off"),
            "brake release": lambda: self._do(controller.release_brakes, "Brake releasing"),
            "unlock protective stop": self._unlock,
            "close safety popup": lambda: "closing safety popup",
            "close popup": lambda: "closing popup",
            "restart safety": self._restart_safety,
            "play": lambda: _result(controller.play_program(), "Starting program", word),
            "pause": lambda: _result(controller.pause_program(), "Pausing program", word),
            "stop": self._stop,
        }
        if word in fixed:
            return fixed[word]()
        for beginning, said in (("popup", "showing popup"), ("addtolog", "Added log message")):
            if word.startswith(beginning):
                controller.events.append(line[:500])
                return said
        if word.startswith("load "):
            return f"File not found: {line[5:]}"
        return f'could not understand: "{line[:200]}"'

    def _do(self, action: object, said: str) -> str:
        if callable(action):
            action()
        return said

    def _state(self) -> str:
        runtime = self._controller.runtime
        return runtime.name if runtime in (RuntimeState.PLAYING, RuntimeState.PAUSED) else "STOPPED"

    def _unlock(self) -> str:
        refused = self._controller.unlock()
        return refused or "Protective stop releasing"

    def _restart_safety(self) -> str:
        controller = self._controller
        if controller.safety in (SafetyMode.FAULT, SafetyMode.VIOLATION) and not controller.blocked:
            controller.power_off()
            controller.set_safety(SafetyMode.NORMAL, "the safety system was restarted")
        return "Restarting safety"

    def _stop(self) -> str:
        running = self._controller.is_running
        self._controller.stop_program("by the dashboard")
        return _result(running or self._controller.safety in MOVING, "Stopped", "stop")


def _result(done: bool, said: str, word: str) -> str:
    return said if done else f"Failed to execute: {word}"
