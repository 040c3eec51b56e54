"""Metrics of a hub for Prometheus: its cells, the age of their states, and the commands that it has sent."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, get_args

from prometheus_client import CONTENT_TYPE_PLAIN_0_0_4, CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

from cobot.fleet.messages import StateWord

if TYPE_CHECKING:
    from cobot.fleet.hub import Hub

CONTENT_TYPE = CONTENT_TYPE_PLAIN_0_0_4
STATES = (*get_args(StateWord), "gone")


def metrics_of(hub: Hub) -> bytes:
    """The metrics of a hub in the text format, version 0.0.4."""
    registry = CollectorRegistry(auto_describe=False)
    ProcessCollector(registry=registry)
    registry.register(HubMetrics(hub))
    return generate_latest(registry)


class HubMetrics(Collector):
    """Reads the hub's data each time that Prometheus asks for the metrics."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub

    def describe(self) -> Iterable[Metric]:
        return ()

    def collect(self) -> Iterator[Metric]:
        robots = self._hub.cells()
        counts = Counter(each["state"] for each in robots)
        states = GaugeMetricFamily("cobot_fleet_robots", "Number of robots in a state.", labels=["state"])
        for state in STATES:
            states.add_metric([state], counts[state])
        yield states
        age = GaugeMetricFamily(
            "cobot_fleet_state_age_seconds", "Age of the latest state of a robot.", labels=["cell", "robot"]
        )
        problems = GaugeMetricFamily(
            "cobot_fleet_problems", "Number of problems that a robot reports.", labels=["cell", "robot"]
        )
        counters = GaugeMetricFamily(  # they restart from 0 with each real-time process
            "cobot_fleet_robot_counter",
            "Number of events since the start of the real-time process of a robot.",
            labels=["cell", "robot", "counter"],
        )
        for each in robots:
            names = [each["cell"], each["robot"]]
            for counter, count in each["counters"].items():
                counters.add_metric([*names, counter], count)
            age.add_metric(names, each["age_s"])
            problems.add_metric(names, len(each["problems"]))
        yield age
        yield problems
        yield counters
        commands = CounterMetricFamily(
            "cobot_fleet_commands", "Answers to commands, by action and code.", labels=["action", "code"]
        )
        for (action, code), count in sorted(self._hub.counts.items()):
            commands.add_metric([action, code], count)
        yield commands
