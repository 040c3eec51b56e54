"""The metrics for Prometheus. Conventions: https://prometheus.io/docs/practices/naming.

All values are read when Prometheus scrapes. The histograms and counters of the cycle are read from shared
memory, where rtloop keeps them in any case. So the metrics do not slow the cycle down. Values that cannot be
read are omitted, and `cobot_rtloop_up` is then 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

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
from cobot.errors import UnavailableError
from cobot.ipc.layout import HISTOGRAM_BUCKETS, Intervention, Phase
from cobot.launch.running_config import ProcessState
from cobot.types import LoopMode

CYCLE_BUCKETS_US = (5, 10, 20, 30, 50, 75, 100, 150, 200, 300, 500, 750, 1000)
"""Upper bounds of the buckets, µs. rtloop counts in steps of 1 µs; its last bucket is "1023 or more"."""
MIDDLES_S = (np.arange(HISTOGRAM_BUCKETS) + 0.5) * 1e-6
ROBOT_METRICS: dict[str, tuple[Callable[..., Any], str, list[str]]] = {
    "rtloop_up": (GaugeMetricFamily, "1 while the real-time process publishes.", []),
    "ready": (GaugeMetricFamily, "1 while the robot accepts motions.", []),
    "mode": (GaugeMetricFamily, "1 for the mode that rtloop is in.", ["mode"]),
    "session_open": (GaugeMetricFamily, "1 while a streaming session is open.", []),
    "realtime_granted": (
        GaugeMetricFamily,
        "1 if the system grants a permission that real-time processes need.",
        ["what"],
    ),
    "cycle_max_seconds": (GaugeMetricFamily, "The longest duration since rtloop started.", ["phase"]),
    "cycle_seconds": (
        HistogramMetricFamily,
        (
            "Duration of the parts of the cycle. Values above 1.0235 ms count as 1.0235 ms; the sum is "
            "accurate to half a microsecond per value."
        ),
        ["phase"],
    ),
    "cycles": (CounterMetricFamily, "Cycles of the real-time process.", []),
    "overruns": (CounterMetricFamily, "Cycles that began too late.", []),
    "torn_reads": (
        CounterMetricFamily,
        "Blocks of shared memory that rtloop could not read at the first attempt.",
        [],
    ),
    "sessions": (CounterMetricFamily, "Requested streaming sessions.", []),
    "interventions": (CounterMetricFamily, "Interventions of the safety layer.", ["kind"]),
    "motions": (CounterMetricFamily, "Ended motions by result.", ["result"]),
}
"""The metrics of each robot: their type, their meaning, and their labels in addition to the robot."""


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
        """Return the metrics in Prometheus's text format, version 0.0.4."""
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
    """Create the metrics of all robots: one family per metric, with the robot's name as a label."""
    families = {
        name: kind(f"cobot_{name}", text, labels=["robot", *labels])
        for name, (kind, text, labels) in ROBOT_METRICS.items()
    }
    for name, services in robots.items():
        _add_values(families, name, services)
    yield from families.values()


def _add_values(families: dict[str, Any], robot: str, services: Services) -> None:
    def add(metric: str, value: float, *labels: str) -> None:
        families[metric].add_metric([robot, *labels], value)

    add("ready", float(not services.health.obstacles()))
    for result, count in services.link.motions.ended.items():
        add("motions", count, result.name.lower())
    if (asked := services.link.sessions()) is not None:
        add("sessions", asked)
    try:
        state, statistics = services.link.state(), services.link.statistics()
    except UnavailableError:
        add("rtloop_up", 0.0)
        return
    add("rtloop_up", float(not services.link.silence(state)))
    for mode in LoopMode:
        add("mode", float(mode is state.mode), mode.name)
    add("session_open", float(state.session != 0))
    for what in ("sched_fifo", "memory_locked"):
        add("realtime_granted", float(statistics[what]), what)
    add("cycles", int(statistics["cycles"]))
    add("overruns", state.overruns)
    add("torn_reads", state.torn_reads)
    for kind, count in zip(Intervention, state.interventions, strict=True):
        add("interventions", count, kind.name.lower())
    for phase in Phase:
        name = phase.name.lower()
        families["cycle_seconds"].add_metric([robot, name], *_cycle_times(statistics["histogram"][phase]))
        add("cycle_max_seconds", 1e-6 * float(statistics["max_us"][phase]), name)


def _cycle_times(counts: np.ndarray) -> tuple[list[tuple[str, float]], float]:
    """Convert a histogram of rtloop to Prometheus's buckets, and return them with the sum of the times, s."""
    below = np.cumsum(counts)
    # Bucket i of rtloop contains times from i µs to less than i + 1 µs.
    cumulative = [*(below[bound - 1] for bound in CYCLE_BUCKETS_US), below[-1]]
    bounds_s = [bound / 1e6 for bound in CYCLE_BUCKETS_US]
    return _buckets(bounds_s, cumulative), float(counts @ MIDDLES_S)


def _buckets(bounds: Iterable[float], cumulative: Iterable[int]) -> list[tuple[str, float]]:
    """Create buckets in Prometheus's form: each consists of an upper bound and the number of values up to
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
