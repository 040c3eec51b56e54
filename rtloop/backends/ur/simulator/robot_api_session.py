"""One client of a simulated controller's Robot API, the HTTP interface of PolyScope X."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import h11

from rtloop.backends.ur.fields import RuntimeState, SafetyMode
from rtloop.backends.ur.robot_api import CONTROL_MODE, PROGRAM, ROOT, STATE
from rtloop.backends.ur.simulator.controller import UrController

MAX_BYTES = 65_536
ROBOT_MODE, SAFETY_MODE, OPERATION_MODE = (
    "/robotstate/v1/robotmode",
    "/robotstate/v1/safetymode",
    "/system/v1/operationalmode",
)
EMERGENCY_STOPS = (SafetyMode.ROBOT_EMERGENCY_STOP, SafetyMode.SYSTEM_EMERGENCY_STOP)
Answer = tuple[int, dict[str, str]]


class RobotApiSession:
    """A `UrSession` for a client of the Robot API. Each connection serves one request."""

    def __init__(self, controller: UrController) -> None:
        self._controller = controller
        self.out, self.is_over = bytearray(), False
        self._http = h11.Connection(h11.SERVER, max_incomplete_event_size=MAX_BYTES)
        self._request: h11.Request | None = None
        self._body = b""

    def feed(self, received: bytes) -> None:
        if self.is_over or not received:
            return
        try:
            self._http.receive_data(received)
            self._take_events()
        except h11.RemoteProtocolError:
            self._send(400, {"message": "Bad Request"})

    def tick(self) -> None:
        """Do nothing, because this session only answers requests."""

    def close(self) -> None:
        """Do nothing, because this session leaves nothing behind in the controller."""

    def _take_events(self) -> None:
        while (event := self._http.next_event()) not in (h11.NEED_DATA, h11.PAUSED):
            if isinstance(event, h11.Request):
                self._request = event
            elif isinstance(event, h11.Data):
                self._body += bytes(event.data)
                if len(self._body) > MAX_BYTES:
                    self._send(413, {"message": "Content Too Large"})
                    return
            elif isinstance(event, h11.EndOfMessage) and self._request is not None:
                path = self._request.target.decode().partition("?")[0].rstrip("/").removeprefix(ROOT)
                self._send(*self._answer(self._request.method.decode(), path))
                return
            elif isinstance(event, h11.ConnectionClosed):
                self.is_over = True
                return

    def _send(self, status: int, content: dict[str, str]) -> None:
        body = json.dumps(content).encode()
        headers = [
            ("Content-Type", "application/json"),
            ("Content-Length", str(len(body))),
            ("Connection", "close"),
        ]
        self.is_over = True
        if self._http.our_state not in (h11.IDLE, h11.SEND_RESPONSE):
            return
        for event in (
            h11.Response(status_code=status, headers=headers),
            h11.Data(data=body),
            h11.EndOfMessage(),
        ):
            self.out += self._http.send(event) or b""

    def _answer(self, method: str, path: str) -> Answer:
        controller = self._controller
        modes: dict[str, Callable[[], str]] = {
            CONTROL_MODE: lambda: "REMOTE" if controller.is_remote else "LOCAL",
            OPERATION_MODE: lambda: "AUTOMATIC",
            ROBOT_MODE: lambda: controller.robot_mode.name,
            SAFETY_MODE: lambda: (
                "EMERGENCY_STOP" if controller.safety in EMERGENCY_STOPS else controller.safety.name
            ),
        }
        if method == "GET" and path in modes:
            return 200, {"mode": modes[path](), "message": "Success"}
        if method == "GET" and path == PROGRAM:
            plays = controller.runtime in (RuntimeState.PLAYING, RuntimeState.PAUSED)
            return 200, {"state": controller.runtime.name if plays else "STOPPED", "message": "Success"}
        if path not in (STATE, PROGRAM):
            return 404, {"message": "Not Found"}
        if method != "PUT":
            return 405, {"message": "Method Not Allowed"}
        if not controller.is_remote:
            return 403, {"message": "Forbidden", "details": "The robot is not in Remote Control"}
        return self._do(path, _action(self._body))

    def _do(self, path: str, action: str) -> Answer:
        controller = self._controller
        doing: dict[str, Callable[[], bool | str | None]]
        if path == PROGRAM:
            doing = {
                "play": controller.play_program,
                "pause": controller.pause_program,
                "resume": controller.play_program,
                "stop": lambda: controller.stop_program("by the Robot API"),
            }
        else:
            doing = {
                "POWER_ON": controller.power_on,
                "POWER_OFF": controller.power_off,
                "BRAKE_RELEASE": controller.release_brakes,
                "UNLOCK_PROTECTIVE_STOP": controller.unlock,
            }
        if action not in doing:
            return 422, {"message": "Unprocessable Content", "details": f"no such action: {action[:50]}"}
        said = doing[action]()
        if said is False or (isinstance(said, str) and said):
            return 409, {"message": "Conflict", "details": said or f"{action} is not possible now"}
        return 200, {"message": "Success"}


def _action(body: bytes) -> str:
    try:
        found: Any = json.loads(body)
    except (ValueError, RecursionError):
        return ""
    return str(found.get("action", "")) if isinstance(found, dict) else ""
