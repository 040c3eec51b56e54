"""The WebSocket for remote clients: the service sends states, the client sends targets."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from typing import Any

import numpy as np
from fastapi import WebSocket, WebSocketDisconnect
from fastapi.responses import JSONResponse

from app.api.dependencies import robots_of, services_of
from app.api.errors import status_of
from app.api.json_text import decoded
from app.api.middleware.access import identity_of
from app.api.route import EndpointRouter
from app.api.stream_frames import (
    ChunkFrame,
    ControlFrame,
    EndFrame,
    EstopFrame,
    Frame,
    JogFrame,
    Pull,
    ReleaseFrame,
    SessionFrame,
    StopFrame,
    SubscribeFrame,
    TextFrame,
    hello_frame,
    read_frame,
    state_frame,
)
from app.api.stream_stop import StreamStop
from app.robot_services import Services
from app.services.clients import CLIENT
from app.services.rights.stop_reason import StopReason
from app.services.rights.stopping import Stopped
from app.services.streaming.jog import Jog
from app.services.streaming.pulling import Pulling
from app.services.streaming.sessions import StreamSession
from cobot import audit
from cobot.access.roles import Role
from cobot.client import wire
from cobot.client.wire import FrameKind
from cobot.clock import Ticks
from cobot.errors import AuthenticationError, CobotError, InputError, PermissionDenied
from cobot.ipc.layout import Stream
from cobot.ipc.state_fields import LAYOUT_VERSION
from cobot.logs import log_context
from cobot.reasons import Reason

MAX_ANSWERS = 64
"""Maximum number of answers that a client has not read yet. If there are more, the oldest is dropped."""

MOVING = frozenset({"session", "jog", "control", "target", "setpoint", "move", "chunk", "estop"})
"""Types of frames that move the arm. An event reports each rejected frame of these types to the other
clients.
"""

router = EndpointRouter()


@router.endpoint(f"WS {wire.PATH}", Role.OBSERVER, timeout_s=2.0)
async def stream(socket: WebSocket) -> None:
    """See docs/stream-protocol.md."""
    timeout_s = float(socket.app.state.endpoints[f"WS {wire.PATH}"].timeout_s)
    try:
        services = services_of(socket)
        with services.streams.connection():
            await StreamConnection(socket, services, timeout_s).serve()
    except CobotError as exc:  # rejected before the connection was accepted
        answer = JSONResponse({"detail": str(exc), "code": exc.code}, status_of(exc))
        await socket.send_denial_response(answer)


class StreamConnection:
    """The connection of one client. Messages are handled as they arrive. Only the newest state is sent, so
    the client may miss others.
    """

    def __init__(self, socket: WebSocket, services: Services, timeout_s: float) -> None:
        self._socket = socket
        self._streams = services.streams
        self._control = services.control
        self._stop = StreamStop(
            {name: each.stopping for name, each in robots_of(socket).items()},
            float(socket.app.state.endpoints["POST /stop"].timeout_s),
            StopReason(f"stopped over the WebSocket by {CLIENT.get()}"),
            self._answer_stop,
        )
        self._timeout_s = timeout_s
        self._session: StreamSession | None = None
        self._jog = Jog(services.robot, services.link, services.streams, self._report_jog_end)
        self._pulling = Pulling(services.link, services.freedrive)
        self._answers: deque[str] = deque(maxlen=MAX_ANSWERS)
        self._wake = asyncio.Event()
        self._ticker: Ticks | None = None
        self._due = self._sequence = self._publication = 0
        self._binary = False
        self._place: dict[str, Any] = {}
        self._tool_version = int(self._streams.info["tool_version"])

    async def serve(self) -> None:
        """Serve until the client disconnects."""
        streams = self._streams
        CLIENT.get().tell = lambda reason: self._answer("control_lost", reason=reason)
        await self._socket.accept()
        hello = hello_frame(
            streams.info,
            robot=streams.robot,
            request=log_context.get().get("request", ""),
            dof=len(streams.info["joint_names"]),
            layout=LAYOUT_VERSION,
            period_s=streams.period_s,
            command_timeout_s=streams.section.command_timeout_s,
        )
        self._say(hello)
        try:
            async with asyncio.TaskGroup() as tasks:
                sender = tasks.create_task(self._send())
                await self._receive()
                sender.cancel()
        finally:
            if self._ticker is not None:
                self._ticker.close()
            self._jog.close()
            self._pulling.close()
            if self._session is not None:
                streams.lose(self._session)

    async def _receive(self) -> None:
        while (message := await self._socket.receive())["type"] == "websocket.receive":
            self._place = {"about": None, "sequence": None}
            try:
                text = message.get("text")
                if text is not None:
                    await self._take_text(text)
                else:
                    await self._take_binary(message["bytes"])
            except CobotError as exc:
                self._answer_error(exc)
                self._tell_refused(exc)
            await asyncio.sleep(0)  # a client that floods this connection must not delay the others

    def _answer_error(self, error: CobotError) -> None:
        details = {"details": dict(error.details)} if error.details else {}
        self._answer("error", code=error.code, detail=str(error), **details, **self._place)

    def _tell_refused(self, error: CobotError) -> None:
        """Report a rejected message, unless the role was insufficient, which `audit.require` reports."""
        about = self._place["about"]
        if about in MOVING and not isinstance(error, AuthenticationError | PermissionDenied):
            audit.report_refusal(f"{about} on the stream", error.code, str(error))

    async def _send(self) -> None:
        """Send messages to the client: first answers, then states. A state is read only when the connection
        is ready for it.
        """
        socket = self._socket
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                self._report_tool()
                while self._answers:
                    await socket.send_text(self._answers.popleft())
                state = self._newest()
                if state is None:
                    continue
                if self._binary:
                    await socket.send_bytes(wire.packed(FrameKind.STATE, self._sequence, state))
                else:
                    await socket.send_text(state_frame(state, self._sequence))
        except WebSocketDisconnect:
            return

    def _report_tool(self) -> None:
        """Report the flange-to-TCP transform if the tool has changed, before the first state with the new
        TCP.
        """
        info = self._streams.info
        if int(info["tool_version"]) != self._tool_version:
            self._tool_version = int(info["tool_version"])
            self._answer("tool", tool_version=self._tool_version, flange=info["flange"].tolist())

    def _newest(self) -> np.ndarray | None:
        """Return the newest state, if a state is due and the newest one has not been sent yet."""
        if not self._due:
            return None
        self._publication, state = self._streams.state_since(self._publication)
        if state is not None:
            self._sequence += self._due
        self._due = 0
        return state

    def _tick(self, times: int) -> None:
        self._due += times
        self._wake.set()

    def _say(self, text: str) -> None:
        self._answers.append(text)
        self._wake.set()

    def _answer(self, kind: str, **content: object) -> None:
        self._say(json.dumps({"type": kind, **content}))

    async def _take_text(self, text: str) -> None:
        content = decoded(text, "the frame")
        if not isinstance(content, dict):
            raise InputError("the frame must be a JSON object")
        kind, sequence = content.get("type"), content.get("sequence")
        self._place["about"] = kind if isinstance(kind, str) else None
        self._place["sequence"] = sequence if isinstance(sequence, int) else None
        await self._take_frame(content)

    async def _take_frame(self, content: Frame) -> None:
        session = self._session
        frame: TextFrame = read_frame(content, Stream.JOINT_IMPEDANCE if session is None else session.stream)
        match frame:
            case SubscribeFrame():
                self._subscribe(frame)
            case SessionFrame():
                await self._open(frame.record(self._streams.info))
            case EstopFrame():
                self._estop()
            case EndFrame():
                self._required.end()
            case StopFrame():
                self._stop.begin(frame.number)
            case ControlFrame():
                self._require_operator("control")
                taken = await self._control.take(frame.timeout_s)
                audit.note("control taken", timeout_s=frame.timeout_s)
                self._answer("control", token=taken.token, timeout_s=frame.timeout_s)
            case ReleaseFrame():
                self._require_operator("release")
                self._control.release()
                audit.note("control released")
                self._answer("control_released")
            case JogFrame():
                await self._take_jog(frame)
            case Pull():
                await self._take_pull(frame)
            case ChunkFrame():
                record = frame.record(len(self._streams.info["joint_names"]))
                self._required.take_chunk(frame.sequence, record)
            case _:
                setpoint = self._required.setpoint.copy()
                frame.fill(setpoint)
                self._required.take_setpoint(frame.sequence, setpoint)

    async def _take_binary(self, frame: bytes) -> None:
        kind, sequence = wire.header(frame)
        self._place |= {"about": kind.name.lower(), "sequence": sequence}
        record = wire.record(frame, len(self._streams.info["joint_names"]))
        match kind:
            case FrameKind.SESSION:
                await self._open(record)
            case FrameKind.SETPOINT:
                self._required.take_setpoint(sequence, record)
            case FrameKind.CHUNK:
                self._required.take_chunk(sequence, record)
            case FrameKind.ESTOP:
                self._estop()
            case FrameKind.END:
                self._required.end()
            case FrameKind.STATE:
                raise InputError("only the service may send states")

    def _estop(self) -> None:
        self._streams.estop(self._required)
        audit.note("estop", session=self._required.number)

    def _answer_stop(self, number: int, done: Stopped) -> None:
        self._answer("stopped", number=number, success=done.success, message=done.message)

    @property
    def _required(self) -> StreamSession:
        if self._session is None:
            raise InputError("there is no session: begin one with a frame of type session")
        return self._session

    def _require_operator(self, what: str) -> None:
        audit.require(identity_of(self._socket), Role.OPERATOR, what, "on the stream")

    def _subscribe(self, frame: SubscribeFrame) -> None:
        if self._ticker is not None:
            self._ticker.close()
        self._binary = frame.format == "binary"
        self._ticker = self._streams.clock.ticker(frame.rate_hz, self._tick)

    async def _take_jog(self, frame: JogFrame) -> None:
        command = frame.command()
        if command is None:
            self._jog.release()
            return
        self._require_operator("jog")
        answer = await self._jog.take(command, self._name, self._timeout_s)
        self._answer("jog", share=answer.share, limited_by=answer.limited_by, **answer.limited_by.fields())

    async def _take_pull(self, frame: Pull) -> None:
        if frame.link is None or frame.point is None or frame.target is None:
            await self._pulling.let_go()
            return
        self._require_operator("pull")
        await self._pulling.pull(frame.link, frame.point, frame.target)
        self._answer("pull", link=frame.link)

    def _report_jog_end(self, reason: Reason) -> None:
        self._answer("jog_ended", reason=reason, **reason.fields())

    @property
    def _name(self) -> str:
        """The client's displayed name."""
        client = self._socket.client
        return f"WS {self._socket.url.path}" + (f" from {client.host}:{client.port}" if client else "")

    def _tell_first_target(self, words: str) -> None:
        self._answer("error", code=InputError.code, detail=words, about="target", sequence=None)

    async def _open(self, request: np.ndarray) -> None:
        self._require_operator("session")
        session = self._session = await self._streams.open(request, self._name, self._timeout_s)
        session.tell = self._tell_first_target
        self._answer("session", number=session.number)
        session.ended.add_done_callback(lambda ended: self._report_end(session.number, ended.result()))

    def _report_end(self, number: int, reason: Reason) -> None:
        self._answer("session_ended", number=number, reason=reason, **reason.fields())
