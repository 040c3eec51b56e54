"""Publishes changes of rtloop's state as events. One task watches each robot.

While there is a listener or the arm is moving, the task reads the state often; otherwise rarely, to save
computing time. The state contains counts of interventions and motions, so none is missed in either case.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator, Callable

from app.services.events.ring import RobotEvents
from app.services.motion.planning import PlanningService
from app.services.rights.ownership import Ownership
from app.services.state.interventions import InterventionLog
from app.services.state.link import RobotLink
from app.services.state.robot_state import RobotState
from cobot.errors import UnavailableError
from cobot.ipc.layout import Intervention
from cobot.reasons import Reason
from cobot.types import RESTING, LoopMode

PERIOD_S, IDLE_PERIOD_S = 0.01, 0.05
EPISODE_S = 1.0
"""Minimum time between two events for the same kind of intervention, s. The first intervention is reported at
once.
"""


class StateWatch:
    """Compares each state with the previous one. The first state causes no event.

    Args:
        stale_s: age of a state above which rtloop is reported as silent, s.
        streamer: function that returns a description of the streaming process.
        replaced: function that returns the number of planning processes that were replaced.
    """

    def __init__(
        self,
        events: RobotEvents,
        stale_s: float,
        streamer: Callable[[], str | None],
        replaced: Callable[[], int],
    ) -> None:
        self._events = events
        self._stale_s = stale_s
        self._streamer = streamer
        self._replaced = replaced
        self._seen: RobotState | None = None
        self._silent = False
        self._cycle = 0
        self._session = 0
        self._workers = replaced()
        self._told: dict[Intervention, tuple[int, float]] = {}

    def look(self, state: RobotState | None, cycle: int, now_s: float) -> None:
        """Publish an event for each change since the last call.

        Args:
            state: None if it cannot be read.
            cycle: number of cycles since rtloop started.
            now_s: the current time, on the link's clock.
        """
        if (replaced := self._replaced()) > self._workers:
            self._workers = replaced
            self._events.publish("planning", what="replaced", replaced=replaced)
        self._look_at_process(state, cycle)
        if state is None:
            return
        before, self._seen = self._seen, state
        if before is None:
            self._session = state.session
            self._told = {kind: (state.interventions[kind], -math.inf) for kind in Intervention}
            return
        self._look_at_mode(before, state)
        self._look_at_session(state)
        self._look_at_interventions(state, now_s)

    def _look_at_process(self, state: RobotState | None, cycle: int) -> None:
        silent = state is None or state.age_s > self._stale_s
        restarted = state is not None and cycle < self._cycle
        if silent and not self._silent and self._seen is not None:
            self._events.publish("rtloop", what="silent")
        elif restarted:
            self._events.publish("rtloop", what="restarted")
        elif self._silent and not silent and self._seen is not None:
            self._events.publish("rtloop", what="back")
        self._silent = silent
        if state is not None:
            self._cycle = cycle

    def _look_at_mode(self, before: RobotState, state: RobotState) -> None:
        if state.mode is before.mode:
            return
        latched = state.mode in (LoopMode.ESTOP, LoopMode.FAULT)
        reason = state.reason if latched or state.mode is LoopMode.STOPPING else Reason("")
        told = {"reason": reason, **reason.fields()}
        self._events.publish("mode", mode=state.mode.name, before=before.mode.name, **told)
        if state.mode is LoopMode.FAULT:
            self._events.publish("fault", **told)
        elif state.mode is LoopMode.ESTOP:
            self._events.publish("estop", what="latched", **told)

    def _look_at_session(self, state: RobotState) -> None:
        if state.session == self._session:
            return
        if self._session:
            told = {"reason": state.reason, **state.reason.fields()}
            self._events.publish("session", what="ended", session=self._session, **told)
        if state.session:
            self._events.publish("session", what="begun", session=state.session, client=self._streamer())
        self._session = state.session

    def _look_at_interventions(self, state: RobotState, now_s: float) -> None:
        for kind, (told, told_s) in self._told.items():
            count = state.interventions[kind]
            if count < told:  # rtloop was restarted and counts from 0 again
                self._told[kind] = count, now_s - EPISODE_S
            elif count > told and now_s - told_s >= EPISODE_S:
                self._told[kind] = count, now_s
                self._events.publish("intervention", kind=kind.name.lower(), new=count - told, count=count)


@contextlib.asynccontextmanager
async def watching(
    link: RobotLink, ownership: Ownership, planning: PlanningService, stale_s: float
) -> AsyncIterator[None]:
    """Watch a robot while the context is open."""
    task = asyncio.create_task(_watch(link, ownership, planning, stale_s), name="events")
    try:
        yield
    finally:
        task.cancel()


async def _watch(link: RobotLink, ownership: Ownership, planning: PlanningService, stale_s: float) -> None:
    log = InterventionLog(link.label, link.clock)
    seen = StateWatch(link.events, stale_s, link.streamer, lambda: planning.status.replaced)
    while True:
        state: RobotState | None = None
        cycle = 0
        with contextlib.suppress(UnavailableError):
            state = link.state()
            cycle = int(link.memory.state.data["cycle"])
            log.look(state)
        _ = ownership.lease.current  # ends a lease that has expired
        seen.look(state, cycle, link.clock.now_s())
        awake = link.events.ring.on_news or (state is not None and state.mode not in RESTING)
        await asyncio.sleep(PERIOD_S if awake else IDLE_PERIOD_S)
