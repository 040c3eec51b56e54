"""The metrics for Prometheus. Conventions: https://prometheus.io/docs/practices/naming.

All values are read when Prometheus scrapes. The histograms and counters of the cycle come from shared memory,
where rtloop counts them anyway, so the metrics do not slow the cycle down. Values that cannot be read are
omitted, and `cobot_rtloop_up` is then 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
)
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector
from prometheus_client.utils import floatToGoString
from starlette.datastructures import State

from app.api.middleware.timing import BUCKETS_S
from app.robot_services import Services
from app.services.reports.health import VERSIONS
from app.services.state.robot_state import RobotState
from cobot.errors import UnavailableError
from cobot.ipc.layout import HISTOGRAM_BUCKETS, Intervention, Phase
from cobot.launch.running_config import ProcessState
from cobot.types import LoopMode

CYCLE_BUCKETS_US = (5, 10, 20, 30, 50, 75, 100, 150, 200, 300, 500, 750, 1000)
"""Upper bounds of the buckets, µs. rtloop counts in steps of 1 µs; its last bucket is "1023 or more"."""
MIDDLES_S = (np.arange(HISTOGRAM_BUCKETS) + 0.5) * 1e-6


class Metrics(Collector):
    """All metrics of the service and its robots.

    Args:
        state: state of the application.
    """

    def __init__(self, state: State) -> None:
        self._state = state
        self._registry = CollectorRegistry(auto_describe=False)
        ProcessCollector(registry=self._registry)
        self._registry.register(self)

    def text(self) -> bytes:
        """The metrics in Prometheus's text format, version 0.0.4."""
        return generate_latest(self._registry)

    def describe(self) -> Iterable[Metric]:
        return ()

    def collect(self) -> Iterator[Metric]:
        yield InfoMetricFamily(
            "cobot_build", "Versions of cobot and of the software that it runs on.", VERSIONS
        )
        yield from _of_robots(self._state.robots)
        yield self._requests()
        yield self._connections()
        events = self._state.events
        listening = len(events.on_news)
        yield GaugeMetricFamily("cobot_events_listeners", "Clients of /events.", listening)
        lost = "Events that clients of /events have missed because they were too slow."
        yield CounterMetricFamily("cobot_events_lost", lost, events.lost)
        yield _restarts(self._state.reloading.processes())

    def _requests(self) -> Metric:
        family = HistogramMetricFamily(
            "cobot_http_request_duration_seconds",
            "HTTP requests by route template, from the request's head to the end of its answer.",
            labels=("method", "route", "status"),
        )
        for (method, route, status), times in self._state.requests.times.items():
            family.add_metric(
                (method, route, str(status)), _buckets(BUCKETS_S, np.cumsum(times.counts)), times.sum_s
            )
        return family

    def _connections(self) -> Metric:
        connected = self._state.rosbridge_connections
        return GaugeMetricFamily("cobot_rosbridge_connections", "Clients of /rosbridge.", connected)


def _of_robots(robots: dict[str, Services]) -> Iterator[Metric]:
    """Make the metrics of all robots: one family per metric, with the robot's name as a label."""
    up = GaugeMetricFamily("cobot_rtloop_up", "1 while the real-time process publishes.", labels=["robot"])
    ready = GaugeMetricFamily("cobot_ready", "1 while the robot accepts motions.", labels=["robot"])
    mode = GaugeMetricFamily("cobot_mode", "1 for the mode that rtloop is in.", labels=["robot", "mode"])
    session = GaugeMetricFamily(
        "cobot_session_open", "1 while a streaming session is open.", labels=["robot"]
    )
    permission = GaugeMetricFamily(
        "cobot_realtime_granted",
        "1 if the system grants a permission that real-time processes need.",
        labels=["robot", "what"],
    )
    slowest = GaugeMetricFamily(
        "cobot_cycle_max_seconds", "The longest duration since rtloop started.", labels=["robot", "phase"]
    )
    cycles = CounterMetricFamily("cobot_cycles", "Cycles of the real-time process.", labels=["robot"])
    overruns = CounterMetricFamily("cobot_overruns", "Cycles that began too late.", labels=["robot"])
    torn = CounterMetricFamily(
        "cobot_torn_reads",
        "Blocks of shared memory that rtloop could not read at the first attempt.",
        labels=["robot"],
    )
    sessions = CounterMetricFamily("cobot_sessions", "Requested streaming sessions.", labels=["robot"])
    interventions = CounterMetricFamily(
        "cobot_interventions", "Interventions of the safety layer.", labels=["robot", "kind"]
    )
    motions = CounterMetricFamily("cobot_motions", "Ended motions by result.", labels=["robot", "result"])
    times = HistogramMetricFamily(
        "cobot_cycle_seconds",
        "Duration of the parts of the cycle. Values above 1.0235 ms count as 1.0235 ms; the sum is accurate "
        "to half a microsecond per value.",
        labels=["robot", "phase"],
    )
    for name, services in robots.items():
        ready.add_metric([name], float(not services.health.obstacles()))
        for result, count in services.link.motions.ended.items():
            motions.add_metric([name, result.name.lower()], count)
        asked = services.link.sessions()
        if asked is not None:
            sessions.add_metric([name], asked)
        try:
            state, statistics = services.link.state(), services.link.statistics()
        except UnavailableError:
            up.add_metric([name], 0.0)
            continue
        up.add_metric([name], float(not services.link.silence(state)))
        for each in LoopMode:
            mode.add_metric([name, each.name], float(each is state.mode))
        session.add_metric([name], float(state.session != 0))
        for what in ("sched_fifo", "memory_locked"):
            permission.add_metric([name, what], float(statistics[what]))
        cycles.add_metric([name], int(statistics["cycles"]))
        _count(state, name, overruns, torn, interventions)
        _time(statistics, name, times, slowest)
    yield from (up, ready, mode, session, permission, slowest, times)
    yield from (cycles, overruns, torn, sessions, interventions, motions)


def _count(
    state: RobotState,
    name: str,
    overruns: CounterMetricFamily,
    torn: CounterMetricFamily,
    interventions: CounterMetricFamily,
) -> None:
    overruns.add_metric([name], state.overruns)
    torn.add_metric([name], state.torn_reads)
    for kind, count in zip(Intervention, state.interventions, strict=True):
        interventions.add_metric([name, kind.name.lower()], count)


def _time(
    statistics: np.ndarray, name: str, times: HistogramMetricFamily, slowest: GaugeMetricFamily
) -> None:
    for phase in Phase:
        labels = [name, phase.name.lower()]
        counts = statistics["histogram"][phase]
        below = np.cumsum(counts)
        # Bucket i of rtloop contains times from i µs to less than i + 1 µs.
        cumulative = [*(below[bound - 1] for bound in CYCLE_BUCKETS_US), below[-1]]
        bounds_s = [bound / 1e6 for bound in CYCLE_BUCKETS_US]
        times.add_metric(labels, _buckets(bounds_s, cumulative), float(counts @ MIDDLES_S))
        slowest.add_metric(labels, 1e-6 * float(statistics["max_us"][phase]))


def _buckets(bounds: Iterable[float], cumulative: Iterable[int]) -> list[tuple[str, float]]:
    """Make buckets in Prometheus's form: each consists of an upper bound and the number of values up to
    it.
    """
    names = [*map(floatToGoString, bounds), "+Inf"]
    return [(name, float(count)) for name, count in zip(names, cumulative, strict=True)]


def _restarts(processes: dict[str, ProcessState]) -> Metric:
    family = CounterMetricFamily(
        "cobot_process_restarts", "How often the supervisor has restarted a process.", labels=["process"]
    )
    for name, process in processes.items():
        family.add_metric([name], process.restarts)
    return family
