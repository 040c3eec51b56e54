"""The whole service on virtual time: the real application beside the real cycle, in one thread, on one clock.

Nothing in here sleeps, and nothing depends on how fast or how busy the computer is: the event loop jumps to
its next timer, and the cycle of each robot is a beat of it. So a second of robot time is a thousand
cycles, whatever they take. Clients speak HTTP and WebSocket to the application itself (ASGI), without a
network; planning and what the service does in threads happen at once, in no time.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any, TypeVar

import httpx
import numpy as np
from asgi_client import EventStream, Socket, SynchronousTransport, gathered
from cobot_run import PATIENT_PLANNING, WAIT_S, unique_name
from rig import Rig
from virtual_time import VirtualClock, VirtualLoop

from app.main import create_app
from app.services.motion.planning import PlanningService, PlanningStatus
from app.services.motion.planning_tasks import surround
from cobot.client.rest import Client
from cobot.config import Settings, load_settings
from cobot.ipc.shm import RobotMemory
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.scene import Scene
from cobot.types import LoopMode
from rtloop import main as rtloop
from rtloop.clock import RealtimeClock
from rtloop.realtime import Permissions

Result = TypeVar("Result")
URL = "http://robot.test"
CAPACITY = 20_000
POLL_S = 0.01


class PlanningHere(PlanningService):
    """Plans at once, in the service's own process."""

    warm = True

    def __init__(self, robot: RobotDescription) -> None:
        self._robot = robot

    def warm_up(self) -> None: ...

    @property
    def status(self) -> PlanningStatus:
        return PlanningStatus("ready", workers=1, usable=1, busy=0, replaced=0, problem="")

    async def compute(
        self, work: Callable[[RobotDescription], Result], timeout_s: float, scene: Scene | None = None
    ) -> Result:
        surround(self._robot, scene or self.scene, self.tool)
        return work(self._robot)

    async def prepare(self, scene: Scene | None = None, processes: int | None = None) -> None: ...

    def close(self) -> None: ...


class Cycle:
    """A robot's cycle as a beat of the loop.

    rtloop stamps what it publishes with the computer's clock, and compares the service's signs of life with
    it. Both are translated where they pass: what it stamps now has happened now, on the virtual clock, and a
    heartbeat is as old for it as it is on that clock.

    Attributes:
        stopped: nothing goes on, as if its process were stopped.
        watch: called after each cycle.
    """

    def __init__(self, rig: Rig, loop: VirtualLoop, clock: VirtualClock) -> None:
        self.rig, self._clock = rig, clock
        self.stopped = False
        self.watch: Callable[[], None] = lambda: None
        state = rig.memory.state
        self._words = state.buffer.view(np.int64)
        numbers = np.arange(len(self._words)).view(state.data.dtype)
        self._stamps = np.concatenate([numbers[name].ravel() for name in self._STAMPS])
        self._real = self._words[self._stamps]
        self._virtual = np.zeros_like(self._real)
        self._beat_ns = 0
        self._beat_sequence = -1
        self._owed = 0.0
        self._beat = loop.every(rig.settings.rt.period_s, self._step)

    _STAMPS = ("monotonic_ns", "measured_monotonic_ns", "deceleration_monotonic_ns", "intervened_ns")

    def close(self) -> None:
        self._beat.close()

    def _step(self) -> None:
        """As many cycles as rtloop's clock would start in this period."""
        if self.stopped:
            return
        self._owed += self.rig.clock.factor if self.rig.mode is LoopMode.TRAJECTORY else 1.0
        while self._owed >= 1.0:
            self._owed -= 1.0
            self._pass_heartbeat()
            self.rig.step()
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
        real = self._words[self._stamps]
        self._virtual[real != self._real] = self._clock.now_ns()
        self._words[self._stamps] = self._virtual
        self.rig.memory.state.publish()
        self._words[self._stamps] = self._real = real


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

    def __init__(
        self,
        folder: Path,
        robots: int = 1,
        more: str = "",
        capacity: int = CAPACITY,
        of_robot: str = "",
        name: str = "",
    ) -> None:
        """more: YAML of further settings; of_robot: of further keys of the section `robot`; name: of a robot
        that has run before.
        """
        names = [name or unique_name() for _ in range(robots)]
        self.names = names
        self.name = names[0]
        several = f"robots: [{', '.join(f'{{name: {name}}}' for name in names)}]\n"
        self.config = folder / f"{self.name}.yaml"
        self.config.write_text(
            "logs: logs\nsequences: {recordings: recordings, programs: programs}\nros: {enabled: false}\n"
            + (several if robots > 1 else f"robot: {{name: {self.name}, {of_robot}}}\n")
            + (more if "planning:" in more else f"planning: {{{PATIENT_PLANNING}}}\n{more}"),
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
        clock = RealtimeClock(period_s)  # which nothing waits for here
        clock.scale(settings.rt.time_factor)
        rig = Rig(settings, robot, simulated=True, memory=memory, clock=clock)
        permissions = Permissions(sched_fifo=False, memory_locked=False, refused="not asked for")
        rtloop._introduce(memory, settings, "virtual", permissions)
        rtloop.describe(memory, robot, rig.simulation)
        return rig

    def _rig_with(
        self, backend: Any, name: str, settings: Settings, robot: RobotDescription, capacity: int, **more: Any
    ) -> Rig:
        """A rig with this backend; `more` are further arguments of `Rig`."""
        memory = RobotMemory.create(self.name, robot.limits.dof, settings.rt.period_s, capacity, self.url)
        rig = Rig(settings, robot, memory=memory, backend=backend, **more)
        memory.statistics.data["backend"] = name.encode()
        memory.statistics.publish()
        rtloop.describe(memory, robot, backend)
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
            self.run(gathered(left))
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
        """What the condition gave when it first held, in two minutes of virtual time.

        Who asks a service computes for longer than ten cycles take, so what takes long is asked less often.
        """
        begin_s = self.clock.now_s()
        while not (value := condition()):
            waited_s = self.clock.now_s() - begin_s
            assert waited_s < WAIT_S, f"did not happen within {WAIT_S} s; logged: {self.output}"
            self.sleep(min(max(POLL_S, waited_s / 10.0), 5.0 * POLL_S))
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
        return Client(url, transport=SynchronousTransport(self))

    def connect(self, path: str, **headers: str) -> Socket:
        """A WebSocket."""
        return Socket(self, path, headers)

    def listen(self, path: str, **headers: str) -> EventStream:
        """Server-sent events."""
        return EventStream(self, path, headers)


class _Lines(logging.Handler):
    def __init__(self, lines: list[str]) -> None:
        super().__init__(logging.INFO)
        self._lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        self._lines.append(f"{record.levelname} {record.getMessage()}")


@contextlib.contextmanager
def virtual_service(folder: Path, robots: int = 1, more: str = "") -> Iterator[VirtualService]:
    with VirtualService(folder, robots, more).serving() as made:
        yield made
