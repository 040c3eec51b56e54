"""The whole service on virtual time: the real application beside the real cycle, in one thread, on one clock.

Nothing in here sleeps, and nothing depends on how fast or how busy the computer is: the event loop jumps to
its next timer, and one of its timers is the cycle of each robot. So a second of robot time is a thousand
cycles, whatever they take. Clients speak HTTP and WebSocket to the application itself (ASGI), without a
network; planning and what the service does in threads happen at once, in no time.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import selectors
import time
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

import httpx
import numpy as np
from fastapi import FastAPI
from rig import Rig
from running import WAIT_S, unique_name

from app.main import create_app
from app.services.motion.planning import PlanningService
from cobot.client.rest import Client
from cobot.config import Settings, load_settings
from cobot.ipc.shm import RobotMemory
from cobot.robot.description import RobotDescription, load_robot
from rtloop import main as rtloop
from rtloop.realtime import Permissions

Result = TypeVar("Result")
URL = "http://robot.test"
CAPACITY = 20_000
POLL_S = 0.01


class _NoFiles(selectors.DefaultSelector):
    """Waits for no file: it only has the time go on to when the loop wants to be woken."""

    def __init__(self, wait: Callable[[float | None], None]) -> None:
        super().__init__()
        self._wait = wait

    def select(self, timeout: float | None = None) -> list[Any]:
        self._wait(timeout)
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop that never waits: when nothing is ready, its time jumps to its next timer."""

    def __init__(self) -> None:
        self._now_s = 1000.0
        super().__init__(_NoFiles(self._pass))

    def time(self) -> float:
        return self._now_s

    def run_in_executor(self, executor: Any, function: Any, *arguments: Any) -> Any:  # type: ignore[override]
        """At once, in this thread: no time goes by."""
        future = self.create_future()
        try:
            future.set_result(function(*arguments))
        except Exception as exc:  # noqa: BLE001 - it belongs to who awaits the future
            future.set_exception(exc)
        return future

    def _pass(self, timeout: float | None) -> None:
        assert timeout is not None, "nothing will ever happen: everybody waits for somebody else"
        self._now_s += timeout


class VirtualClock:
    """`cobot.clock.Clock` on a virtual loop. A thread's sleep has the loop go on."""

    def __init__(self, loop: VirtualLoop) -> None:
        self._loop = loop
        self._epoch_ns = time.time_ns() - self.now_ns()

    def now_s(self) -> float:
        return self._loop.time()

    def now_ns(self) -> int:
        return round(self._loop.time() * 1e9)

    def wall_ns(self) -> int:
        return self._epoch_ns + self.now_ns()

    def sleep(self, seconds: float) -> None:
        self._loop.run_until_complete(asyncio.sleep(seconds))

    def ticker(self, rate_hz: float, on_tick: Callable[[int], None]) -> VirtualTicks:
        return VirtualTicks(self._loop, 1.0 / rate_hz, on_tick)


class VirtualTicks:
    """Ticks on the loop's own timers."""

    def __init__(self, loop: VirtualLoop, period_s: float, on_tick: Callable[[int], None]) -> None:
        self._loop, self._period_s, self._on_tick = loop, period_s, on_tick
        self._due_s = loop.time() + period_s
        self._timer = loop.call_at(self._due_s, self._tick)

    def close(self) -> None:
        self._timer.cancel()

    def _tick(self) -> None:
        self._due_s += self._period_s
        self._timer = self._loop.call_at(self._due_s, self._tick)
        self._on_tick(1)


class PlanningHere(PlanningService):
    """Plans at once, in the service's own process."""

    def __init__(self, robot: RobotDescription) -> None:
        self._robot = robot

    async def warm_up(self) -> None: ...

    async def compute(self, work: Callable[[RobotDescription], Result], timeout_s: float) -> Result:
        return work(self._robot)

    def close(self) -> None: ...


class Cycle:
    """A robot's cycle as a timer of the loop.

    rtloop stamps what it publishes with the computer's clock, and compares the service's signs of life with
    it. Both are translated where they pass: what it stamps now has happened now, on the virtual clock, and a
    heartbeat is as old for it as it is on that clock.

    Attributes:
        stopped: nothing goes on, as if its process were stopped.
        watch: called after each cycle.
    """

    def __init__(self, rig: Rig, loop: VirtualLoop, clock: VirtualClock) -> None:
        self.rig, self._loop, self._clock = rig, loop, clock
        self.stopped = False
        self.watch: Callable[[], None] = lambda: None
        state = rig.memory.state.data
        self._real = {name: state[name].copy() for name in self._STAMPS}
        self._virtual = {name: np.zeros_like(state[name]) for name in self._STAMPS}
        self._beat_ns = 0
        self._beat_sequence = -1
        self._due_s = loop.time()
        self._timer = loop.call_soon(self._step)

    _STAMPS = ("monotonic_ns", "measured_monotonic_ns", "deceleration_monotonic_ns", "intervened_ns")

    def close(self) -> None:
        self._timer.cancel()

    def _step(self) -> None:
        self._due_s += self.rig.settings.rt.period_s
        self._timer = self._loop.call_at(self._due_s, self._step)
        if not self.stopped:
            self._pass_heartbeat()
            self.rig.loop.step()
            self._pass_state()
            self.watch()

    def _pass_heartbeat(self) -> None:
        block = self.rig.memory.heartbeat
        if block.sequence != self._beat_sequence:
            assert block.try_read()
            self._beat_ns = int(block.data["monotonic_ns"])
        silent_ns = self._clock.now_ns() - self._beat_ns
        block.data["monotonic_ns"] = time.monotonic_ns() - silent_ns
        block.publish()
        self._beat_sequence = block.sequence

    def _pass_state(self) -> None:
        block, now_ns = self.rig.memory.state, self._clock.now_ns()
        state = block.data
        for name in self._STAMPS:
            new = state[name] != self._real[name]
            self._real[name] = state[name].copy()
            self._virtual[name] = np.where(new, now_ns, self._virtual[name])
            state[name] = self._virtual[name]
        block.publish()
        for name in self._STAMPS:
            state[name] = self._real[name]


class VirtualService:
    """What `cobot run` runs, without processes.

    Methods that ask something have time go on until there is an answer. A test's own waiting is `sleep` and
    `until`; to have something go on meanwhile, `begin` it.

    Attributes:
        name: of the (first) robot.
        names: of all.
        rigs: by name.
        app: the application.
        lines: what it has logged.
    """

    def __init__(self, folder: Path, robots: int = 1, more: str = "", capacity: int = CAPACITY) -> None:
        """more: YAML of further settings."""
        names = [unique_name() for _ in range(robots)]
        self.names = names
        self.name = names[0]
        several = f"robots: [{', '.join(f'{{name: {name}}}' for name in names)}]\n"
        self.config = folder / f"{self.name}.yaml"
        self.config.write_text(
            "logs: logs\nsequences: {recordings: recordings, programs: programs}\nros: {enabled: false}\n"
            + (several if robots > 1 else f"robot: {{name: {self.name}}}\n")
            + more,
            encoding="utf-8",
        )
        settings = load_settings(self.config)
        self.loop = VirtualLoop()
        self.clock = VirtualClock(self.loop)
        self.url = URL
        self.lines: list[str] = []
        self.rigs: dict[str, Rig] = {}
        self.cycles: dict[str, Cycle] = {}
        descriptions = {name: load_robot(each) for name, each in settings.each.items()}
        for name, each in settings.each.items():
            self.rigs[name] = self._rig(each, descriptions[name], capacity, robots > 1)
        self.app = create_app(
            settings, self.config, URL, self.clock, lambda _, __, name: PlanningHere(descriptions[name])
        )
        self._http = httpx.AsyncClient(transport=httpx.ASGITransport(self.app), base_url=URL, timeout=None)

    def _rig(self, settings: Settings, robot: RobotDescription, capacity: int, several: bool) -> Rig:
        name, period_s = settings.robot.name, settings.rt.period_s
        url = f"{URL}/robots/{name}" if several else URL
        memory = RobotMemory.create(name, robot.limits.dof, period_s, capacity, url)
        rig = Rig(settings, robot, simulated=True, memory=memory)
        permissions = Permissions(sched_fifo=False, memory_locked=False, refused="not asked for")
        rtloop._introduce(memory, settings.rt, "virtual", permissions)
        rtloop._describe(memory, robot, rig.simulation)
        return rig

    @contextlib.contextmanager
    def serving(self) -> Iterator[VirtualService]:
        """Until the context ends."""
        asyncio.set_event_loop(None)
        handler = _Lines(self.lines)
        root = logging.getLogger("cobot")
        level = root.level
        root.addHandler(handler)
        root.setLevel(logging.INFO)
        self.cycles = {name: Cycle(rig, self.loop, self.clock) for name, rig in self.rigs.items()}
        lifespan = self.app.router.lifespan_context(self.app)
        try:
            self.run(lifespan.__aenter__())
            self.sleep(0.1)
            yield self
            self.run(lifespan.__aexit__(None, None, None))
        finally:
            root.removeHandler(handler)
            root.setLevel(level)
            self._end()

    def _end(self) -> None:
        for cycle in self.cycles.values():
            cycle.close()
        self.run(self._http.aclose())
        left = asyncio.all_tasks(self.loop)
        for task in left:
            task.cancel()
        if left:
            self.run(_gathered(left))
        self.loop.close()
        for rig in self.rigs.values():
            rig.close()

    @property
    def rig(self) -> Rig:
        return self.rigs[self.name]

    @property
    def output(self) -> str:
        return "\n".join(self.lines)

    def run(self, work: Coroutine[Any, Any, Result]) -> Result:
        """The result; time goes on meanwhile."""
        return self.loop.run_until_complete(work)

    def begin(self, work: Coroutine[Any, Any, Result]) -> asyncio.Task[Result]:
        """Have something done while the test goes on; `end` has its result."""
        return self.loop.create_task(work)

    def end(self, task: asyncio.Task[Result]) -> Result:
        return self.loop.run_until_complete(asyncio.wait_for(task, WAIT_S))

    def sleep(self, seconds: float) -> None:
        """Let so much time go by."""
        self.clock.sleep(seconds)

    def until(self, condition: Callable[[], Any]) -> Any:
        """What the condition gave when it first held, in a minute of virtual time."""
        deadline_s = self.clock.now_s() + WAIT_S
        while not (value := condition()):
            assert self.clock.now_s() < deadline_s, f"did not happen within {WAIT_S} s; logged: {self.output}"
            self.sleep(POLL_S)
        return value

    # Its clients

    async def asking(self, method: str, path: str, **content: Any) -> httpx.Response:
        return await self._http.request(method, path, **content)

    def ask(self, method: str, path: str, **content: Any) -> httpx.Response:
        return self.run(self.asking(method, path, **content))

    def get(self, path: str) -> httpx.Response:
        return self.ask("GET", path)

    def post(self, path: str, json: Any = None, **content: Any) -> httpx.Response:
        return self.ask("POST", path, json=json, **content)

    def health(self) -> dict[str, Any]:
        found: dict[str, Any] = self.get("/health").json()
        return found

    def healthy(self) -> bool:
        return all(each["status"] == "ok" for each in self.health()["robots"].values())

    def joints(self) -> list[float]:
        return list(self.get("/robot/joint_states").raise_for_status().json()["position"])

    def go_home(self) -> None:
        """Also from a motion; it ends what else moves the arm."""
        self.post("/stop").raise_for_status()
        home = self.post("/robot/move/named", {"name": "home", "speed": 1.0})
        assert home.json()["success"], home.text

    def client(self, url: str) -> Client:
        """The Python client of REST."""
        return Client(url, transport=_Synchronous(self))

    def connect(self, path: str, **headers: str) -> Socket:
        """A WebSocket."""
        return Socket(self, path, headers)


class _Lines(logging.Handler):
    def __init__(self, lines: list[str]) -> None:
        super().__init__(logging.INFO)
        self._lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        self._lines.append(f"{record.levelname} {record.getMessage()}")


class _Synchronous(httpx.BaseTransport):
    """httpx's synchronous client at a virtual service."""

    def __init__(self, service: VirtualService) -> None:
        self._service = service

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        content = request.read()
        answer = self._service.run(
            self._service.asking(
                request.method, str(request.url), headers=dict(request.headers), content=content
            )
        )
        return httpx.Response(answer.status_code, headers=answer.headers, content=answer.content)


async def _gathered(tasks: set[asyncio.Task[Any]]) -> None:
    await asyncio.gather(*tasks, return_exceptions=True)


class Refused(Exception):
    """The service has denied a WebSocket."""

    def __init__(self, status: int, body: bytes) -> None:
        super().__init__(f"HTTP {status}")
        self.status, self.body = status, body


class Closed(Exception):
    """The service has closed a WebSocket; the code says why."""


class Socket:
    """A client's end of a WebSocket to the application; at most `unread` messages wait for who does not read.

    Raises:
        Refused: the service does not accept it.
    """

    _ports = iter(range(50_000, 60_000))

    def __init__(self, service: VirtualService, path: str, headers: dict[str, str]) -> None:
        self._service = service
        self._inbox: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._outbox: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._inbox.put_nowait({"type": "websocket.connect"})
        self._task = service.begin(self._serve(service.app, path, headers))
        first = service.run(self._next())
        if first["type"] == "websocket.http.response.start":
            raise Refused(first["status"], service.run(self._next())["body"])
        assert first["type"] == "websocket.accept", first

    def __enter__(self) -> Socket:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def _serve(self, app: FastAPI, path: str, headers: dict[str, str]) -> None:
        scope = {
            "type": "websocket",
            "asgi": {"version": "3.0", "spec_version": "2.4"},
            "http_version": "1.1",
            "scheme": "ws",
            "path": path,
            "raw_path": path.encode(),
            "query_string": b"",
            "root_path": "",
            "headers": [
                (name.lower().encode(), value.encode())
                for name, value in {"host": urlsplit(URL).netloc, **headers}.items()
            ],
            "client": ("127.0.0.1", next(self._ports)),
            "server": ("robot.test", 80),
            "subprotocols": [],
            "state": {},
            "extensions": {"websocket.http.response": {}},
        }
        try:
            await app(scope, self._inbox.get, self._outbox.put)
        finally:
            self._outbox.put_nowait({"type": "websocket.close", "code": 1006})

    async def _next(self) -> dict[str, Any]:
        return await asyncio.wait_for(self._outbox.get(), WAIT_S)

    def send(self, frame: str | bytes) -> None:
        """Time does not go on: the service reads it when it next has its turn."""
        kind = "text" if isinstance(frame, str) else "bytes"
        self._inbox.put_nowait({"type": "websocket.receive", kind: frame})

    def recv(self, timeout_s: float = WAIT_S) -> str | bytes:
        """The next frame; time goes on until there is one."""
        del timeout_s
        message = self._service.run(self._next())
        if message["type"] == "websocket.close":
            if self._task.done():
                self._task.result()
            raise Closed(message["code"])
        text = message.get("text")
        return text if text is not None else message["bytes"]

    def close(self) -> None:
        """As a client that goes."""
        self._inbox.put_nowait({"type": "websocket.disconnect", "code": 1000})
        self._service.run(_gathered({self._task}))


@contextlib.contextmanager
def virtual_service(folder: Path, robots: int = 1, more: str = "") -> Iterator[VirtualService]:
    with VirtualService(folder, robots, more).serving() as made:
        yield made
