"""What Prometheus scrapes. Oracles: its own parser, and what the clients have done and seen."""

from __future__ import annotations

import asyncio
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families
from virtual_service import VirtualService

from app.api.costly import MAX_REST_S
from app.api.metrics import CYCLE_BUCKETS_US
from app.api.middleware.timing import BUCKETS_S, RequestTimes, RequestTiming
from cobot.ipc.layout import HISTOGRAM_BUCKETS, Intervention, Phase

DOCS = Path(__file__).parents[3] / "docs"
Samples = dict[tuple[Any, ...], float]


def scraped(pair: VirtualService) -> Samples:
    answer = pair.get("/metrics")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "text/plain; version=0.0.4; charset=utf-8"
    return {
        (sample.name, *sorted(sample.labels.values())): sample.value
        for family in text_string_to_metric_families(answer.text)
        for sample in family.samples
    }


def difference(pair: VirtualService, before: Samples) -> Samples:
    after = scraped(pair)
    return {key: value - before.get(key, 0.0) for key, value in after.items()}


def test_names_and_units_are_as_prometheus_wants_them(pair: VirtualService) -> None:
    families = list(text_string_to_metric_families(pair.get("/metrics").text))
    assert len({family.name for family in families}) == len(families)
    for family in families:
        assert family.documentation
        assert family.name.startswith(("cobot_", "process_"))
        assert not family.name.endswith(("_ms", "_us", "_ns", "_milliseconds"))
        for sample in family.samples:
            if family.type == "counter" and not family.name.startswith("process_"):
                assert sample.name.endswith("_total")
            if family.type == "histogram":
                assert "seconds" in family.name


def test_what_the_documentation_names_is_there_and_its_alerts_are_yaml(pair: VirtualService) -> None:
    pair.get("/health/live")  # the durations of requests begin with the first one
    scrape = pair.get("/metrics").text
    page = (DOCS / "operations.md").read_text(encoding="utf-8")
    for text in (page, (DOCS / "state-and-stop.md").read_text(encoding="utf-8")):
        for name in set(re.findall(r"\bcobot_[a-z_]+", text)):
            assert re.search(rf"^(# TYPE )?{name}\b", scrape, re.MULTILINE), name
    blocks = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    groups = [group for block in blocks for group in yaml.safe_load(block).get("groups", [])]
    rules = [rule for group in groups for rule in group["rules"]]
    assert len(rules) >= 8
    assert all(rule["expr"] and rule["alert"] for rule in rules)


def test_every_robot_has_its_own(pair: VirtualService) -> None:
    samples = scraped(pair)
    for name in pair.names:
        assert samples["cobot_rtloop_up", name] == 1
        assert samples["cobot_ready", name] == 1
        assert samples["cobot_mode", "HOLD", name] == 1
        assert sum(value for key, value in samples.items() if key[0] == "cobot_mode" and name in key) == 1
        assert samples["cobot_cycles_total", name] >= 0
        for kind in Intervention:
            assert ("cobot_interventions_total", *sorted([kind.name.lower(), name])) in samples


def test_the_histograms_are_rtloops_own(pair: VirtualService) -> None:
    pair.sleep(MAX_REST_S)  # no cycle comes between: the last answer took a slow computer long
    name = pair.names[1]
    block = pair.rigs[name].memory.statistics
    counts = np.zeros((len(Phase), HISTOGRAM_BUCKETS), np.uint32)
    counts[Phase.TOTAL, [0, 4, 5, 99, 100, 999, 1000, 1023]] = [1, 2, 4, 8, 16, 32, 64, 128]
    block.data["histogram"] = counts
    block.data["max_us"][Phase.TOTAL] = 2500.0
    block.publish()
    samples = scraped(pair)

    def below(bound: str) -> float:
        return samples["cobot_cycle_seconds_bucket", *sorted([bound, name, "total"])]

    assert below("5e-06") == 3  # 0 to less than 5 µs
    assert below("1e-05") == 7
    assert below("0.0001") == 15
    assert below("0.00015") == 31
    assert below("0.001") == 63
    assert below("+Inf") == 255 == samples["cobot_cycle_seconds_count", *sorted([name, "total"])]
    middles = np.arange(HISTOGRAM_BUCKETS) + 0.5
    wanted = float(counts[Phase.TOTAL] @ middles) * 1e-6
    assert samples["cobot_cycle_seconds_sum", *sorted([name, "total"])] == pytest.approx(wanted)
    assert samples["cobot_cycle_max_seconds", *sorted([name, "total"])] == pytest.approx(2.5e-3)
    assert max(CYCLE_BUCKETS_US) < HISTOGRAM_BUCKETS


def test_motions_are_counted_by_how_they_ended(pair: VirtualService) -> None:
    """Also those that nobody waits for, one after the other."""
    name = pair.names[0]
    before = scraped(pair)
    pair.go_home()
    for goal in ("work", "transport", "home"):
        assert pair.post("/robot/move/named", {"name": goal, "speed": 1.0}).json()["success"]
    long = {"points": [{"positions": [0.5, 0, 0, -1.57, 0, 1.57, 0], "time_from_start": 60.0}]}
    assert pair.post("/trajectory/send", long).json()["status"] == "sent"
    pair.sleep(1.0)
    pair.post("/stop")
    assert pair.post("/trajectory/send", long).json()["status"] == "sent"
    pair.sleep(1.0)
    pair.rig.loopback.fail_read = ""
    pair.rig.request("estops")
    pair.sleep(3.0)
    found = difference(pair, before)
    ends = {
        result: found["cobot_motions_total", *sorted([name, result])]
        for result in ("arrived", "stopped", "failed")
    }
    assert ends == {"arrived": 3, "stopped": 1, "failed": 1}
    assert found["cobot_motions_total", *sorted([pair.names[1], "arrived"])] == 0
    assert scraped(pair)["cobot_mode", "ESTOP", name] == 1
    assert scraped(pair)["cobot_ready", name] == 0
    pair.post("/robot/reset")
    pair.go_home()


def test_requests_are_counted_by_route_and_status_whatever_is_asked_for(pair: VirtualService) -> None:
    name = pair.names[1]
    before = scraped(pair)
    for path in (
        f"/robots/{name}/pose",
        f"/robots/{name}/pose",
        "/robots/nobody/pose",
        "/nothing/1",
        "/nothing/2",
    ):
        pair.get(path)
    pair.ask("BREW", "/robot/pose")
    pair.post("/robot/move/joints", {"joints": [9.0] * 7})
    found = difference(pair, before)

    def count(*labels: str) -> float:
        return found.get(("cobot_http_request_duration_seconds_count", *sorted(labels)), 0.0)

    assert count("GET", "/robots/{robot}/pose", "200") == 2
    assert count("GET", "/robots/{robot}/pose", "404") == 1
    assert count("GET", "none", "404") == 2
    assert count("POST", "/robot/move/joints", "422") == 1
    assert not any("BREW" in key for key in found)
    bucket = (
        "cobot_http_request_duration_seconds_bucket",
        *sorted(["+Inf", "GET", "/robots/{robot}/pose", "200"]),
    )
    assert found[bucket] == 2


def test_an_rtloop_that_has_gone_leaves_the_rest(pair: VirtualService) -> None:
    name = pair.names[1]
    pair.cycles[name].stopped = True
    pair.sleep(1.0)
    samples = scraped(pair)
    assert samples["cobot_rtloop_up", name] == 0
    assert samples["cobot_ready", name] == 0
    assert samples["cobot_rtloop_up", pair.names[0]] == 1
    pair.cycles[name].stopped = False
    pair.sleep(1.0)
    assert scraped(pair)["cobot_rtloop_up", name] == 1


def test_streaming_sessions_are_counted(pair: VirtualService) -> None:
    rig = pair.rigs[pair.names[1]]
    before = scraped(pair)
    rig.memory.session.data["number"] += 3
    rig.memory.session.publish()
    assert difference(pair, before)["cobot_sessions_total", pair.names[1]] == 3


async def _answer(scope: Any, receive: Any, send: Any) -> None:
    if scope["path"] == "/broken":
        raise RuntimeError("broken")
    if scope["path"] == "/gone":
        raise asyncio.CancelledError
    await send({"type": "http.response.start", "status": 204, "headers": []})
    await send({"type": "http.response.body"})


@pytest.mark.parametrize(("path", "status"), [("/good", 204), ("/broken", 500), ("/gone", 499)])
def test_what_ends_without_an_answer_is_counted_too(path: str, status: int) -> None:
    times = RequestTimes()

    async def send(_: Any) -> None: ...

    async def ask() -> None:
        scope = {"type": "http", "method": "GET", "path": path}
        try:
            await RequestTiming(_answer, times)(scope, None, send)  # type: ignore[arg-type]
        except (RuntimeError, asyncio.CancelledError):
            assert status != 204

    asyncio.run(ask())
    assert list(times.times) == [("GET", "none", status)]


def test_times_are_in_the_bucket_whose_bound_they_do_not_exceed() -> None:
    times = RequestTimes()
    for seconds in (0.0, 0.001, 0.0011, 60.0, 61.0):
        times.add("GET", "/", 200, seconds)
    (found,) = times.times.values()
    assert found.counts == [2, 1, *[0] * (len(BUCKETS_S) - 3), 1, 1]
    assert found.sum_s == pytest.approx(121.0021)


def test_measuring_a_request_costs_next_to_nothing() -> None:
    """Some microseconds, of the hundreds that a request takes: bound for a busy computer."""
    timing = RequestTiming(_answer, RequestTimes())

    async def send(_: Any) -> None: ...

    scope = {"type": "http", "method": "GET", "path": "/"}

    async def ask() -> float:
        best = float("inf")
        for _ in range(20):
            begun_s = time.perf_counter()
            for _ in range(100):
                await timing(scope, None, send)  # type: ignore[arg-type]
            best = min(best, time.perf_counter() - begun_s)
        return best / 100

    assert asyncio.run(ask()) < 50e-6
