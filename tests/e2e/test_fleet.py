"""A fleet of processes: a hub, a cell with its arm, and cells that come and go.

Oracles: a plain session of Zenoh in the process of the tests, which knows nothing of the hub; the service of
the cell, with its jobs and its audit; Linux's signals; a TCP proxy that cuts connections; Chromium.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from chromium import Page, browsing
from cobot_run import Run, again, answering, until
from fleets import FLEET, Hub, OtherCell, free_port

from cobot.fleet.__main__ import main
from cobot.launch.stop import stop

if importlib.util.find_spec("zenoh") is None:
    pytest.skip("Zenoh is not installed: it is in the extra fleet", allow_module_level=True)
import zenoh

AUDITED = "stop {}"


@pytest.fixture(scope="module")
def hub() -> Iterator[Hub]:
    started = Hub()
    yield started
    started.close()


@pytest.fixture(scope="module")
def cell(hub: Hub, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """A whole `cobot run` in real time, which is the cell `one`."""
    fleet = f"{{name: {FLEET}, cell: one, connect: ['tcp/127.0.0.1:{hub.zenoh_port}']}}"
    run = Run(tmp_path_factory.mktemp("cell"), clock="realtime", more=f"fleet: {fleet}\n")
    with answering(run) as started:
        started.until(lambda: hub.robot("one")["state"] == "ready")
        yield started


@pytest.fixture(scope="module")
def foreign(hub: Hub) -> Iterator[Any]:
    """A client that knows Zenoh, and of cobot only what docs/fleet.md says of the keys."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{hub.zenoh_port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    yield session
    session.close()


@pytest.fixture
def other(hub: Hub, cell: Run, tmp_path: Path) -> Iterator[Callable[..., OtherCell]]:
    with contextlib.ExitStack() as stack:

        def make(name: str, more: str = "", port: int = hub.zenoh_port) -> OtherCell:
            made = OtherCell(port, cell, tmp_path, name, more)
            stack.callback(made.close)
            return made

        yield make


def answers_of(session: Any, key: str, payload: bytes | None = None) -> list[Any]:
    replies = session.get(key, payload=payload, timeout=20.0, consolidation=zenoh.ConsolidationMode.NONE)
    return [json.loads(bytes(reply.ok.payload)) for reply in replies if reply.ok is not None]


def stop_of(session: Any, **changes: Any) -> bytes:
    """A stop, as docs/fleet.md describes it."""
    (now,) = answers_of(session, f"cobot/{FLEET}/@hub/time")
    times = {"epoch": now["epoch"], "issued_s": now["time_s"], "expires_s": now["time_s"] + 10.0}
    whom = {"fleet": FLEET, "cell": "one", "robot": "*"}
    action = {"kind": "stop"}
    body = {"id": os.urandom(8).hex(), "action": action, "who": "foreign client", "role": "operator", **whom}
    return json.dumps(body | times | changes).encode()


def stops_in_audit(run: Run, who: str) -> list[dict[str, Any]]:
    entries = httpx.get(f"{run.url}/audit").json()["entries"]
    return [each for each in entries if each["who"] == who and each["from"] == "fleet"]


def begin_motion(run: Run) -> str:
    """A slow motion of many seconds: its job."""
    jobs: list[str] = []

    def attempt() -> tuple[bool, str]:
        joints = run.joints()
        joints[0] += 1.2 if joints[0] < 0.0 else -1.2
        body = {"joints": joints, "speed": 0.02}
        answer = httpx.post(f"{run.url}/robot/move/joints", params={"wait": False}, json=body, timeout=60.0)
        assert answer.status_code in (200, 202), answer.text
        jobs.append(str(answer.json()["id"]))
        run.until(lambda: job_state(run, jobs[-1]) not in ("queued", "planning"))
        told = httpx.get(f"{run.url}/jobs/{jobs[-1]}")
        return told.json()["state"] == "running", told.text

    again(attempt)
    return jobs[-1]


def require_stopped(run: Run, job: str) -> None:
    run.until(lambda: job_state(run, job) != "running")
    assert job_state(run, job) == "cancelled", httpx.get(f"{run.url}/jobs/{job}").text


def job_state(run: Run, job: str) -> str:
    return str(httpx.get(f"{run.url}/jobs/{job}").json()["state"])


def wait_on(page: Page, script: str) -> None:
    until(lambda: page.run(script), lambda: f": {script}")


@pytest.fixture
def fleet(hub: Hub, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Runs `cobot fleet` in this process: its status, output and errors."""
    monkeypatch.setenv("COBOT_FLEET", hub.url)

    def run(*words: str) -> tuple[int, str, str]:
        try:
            status = main(words)
        except SystemExit as end:  # of argparse
            status = int(end.code or 0)
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


def test_the_hub_and_a_foreign_client_see_the_state_and_the_events(hub: Hub, cell: Run, foreign: Any) -> None:
    (state,) = answers_of(foreign, f"cobot/{FLEET}/one/*/state")
    shown = until(lambda: (found := hub.robot("one"))["speed_override"] == 1.0 and found["backend"] and found)
    assert (state["cell"], state["robot"], state["mode"]) == ("one", cell.name, "HOLD")
    assert (shown["state"], shown["robot"], shown["backend"]) == ("ready", cell.name, "mujoco")
    assert shown["panel"] == cell.url
    (told,) = answers_of(foreign, f"cobot/{FLEET}/one/{cell.name}/events")
    assert "started" in [event["data"].get("what") for event in told]
    told_ids = {event["id"] for event in told}
    until(
        lambda: told_ids <= {each["id"] for each in httpx.get(f"{hub.url}/cells/one/events").json()["events"]}
    )


def test_a_moving_arm_is_published_and_stopped_and_the_audit_says_by_whom(hub: Hub, cell: Run) -> None:
    job = begin_motion(cell)
    before = hub.robot("one")["counters"]
    until(lambda: hub.robot("one")["state"] == "moving" and "move/joints" in hub.robot("one")["job"])
    answer = hub.stop("/cells/one/stop")
    assert answer["at_rest"]
    assert [each["code"] for each in answer["robots"]] == ["ok"]
    require_stopped(cell, job)
    assert hub.robot("one")["counters"].keys() == before.keys()
    until(lambda: hub.robot("one")["counters"]["stops"] > before["stops"])
    (entry,) = until(lambda: stops_in_audit(cell, '"ada"'))
    assert (entry["what"], entry["outcome"]) == (AUDITED.format(cell.name), "ok")
    assert entry["details"]["command"] == answer["robots"][0]["id"]
    hub.until_state("one", "ready")


def test_a_stop_of_a_foreign_client_is_executed_once(cell: Run, foreign: Any) -> None:
    key = f"cobot/{FLEET}/one/{cell.name}/command"
    stop = stop_of(foreign)
    (first,), (again,) = answers_of(foreign, key, stop), answers_of(foreign, key, stop)
    assert (first["code"], first["repeated"]) == ("ok", False)
    assert again == first | {"repeated": True}
    assert len(stops_in_audit(cell, '"foreign client"')) == 1, "in quotes, as any name that proves nothing"


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"issued_s": 1.0, "expires_s": 2.0}, "conflict", "late and was not executed"),
        ({"epoch": "0123456789abcdef"}, "conflict", "is not the epoch of the current hub"),
        ({"expires_s": 1e12}, "input", "allowed: more than 0 and up to 60 s"),
        ({"action": {"kind": "dance"}}, "input", "action"),
        ({"action": {"kind": "start", "program": "pick"}}, "forbidden", "accepts only stops"),
        ({"who": ""}, "input", "who: "),
        ({"role": "god"}, "input", "role: "),
        ({"cell": "two"}, "input", "the command is for test-hall/two/*, but test-hall/one/"),
        ({"fleet": "other"}, "input", "the command is for other/one/*"),
    ],
)
def test_a_stop_that_is_late_or_invalid_is_refused_with_a_reason(
    cell: Run, foreign: Any, changes: dict[str, Any], code: str, words: str
) -> None:
    (answer,) = answers_of(foreign, f"cobot/{FLEET}/one/{cell.name}/command", stop_of(foreign, **changes))
    assert (answer["code"], words in answer["text"]) == (code, True), answer


def test_a_state_with_a_foreign_name_or_without_a_cell_is_ignored(hub: Hub, cell: Run, foreign: Any) -> None:
    (state,) = answers_of(foreign, f"cobot/{FLEET}/one/{cell.name}/state")
    for changes, key in (
        ({"mode": "FAULT", "instance": "0123456789abcdef"}, f"cobot/{FLEET}/one/{cell.name}/state"),
        ({}, f"cobot/{FLEET}/ghost/{cell.name}/state"),
        ({"cell": "ghost"}, f"cobot/{FLEET}/ghost/{cell.name}/state"),
    ):
        foreign.put(key, json.dumps(state | changes).encode())
    foreign.put(f"cobot/{FLEET}/one/{cell.name}/state", b"\xff no JSON")
    before_s = hub.robot("one")["age_s"]
    until(lambda: hub.robot("one")["age_s"] < before_s or hub.robot("one")["age_s"] < 0.2)
    assert hub.robot("one")["mode"] == "HOLD"
    assert not hub.robot("ghost")["alive"]


def test_a_cut_connection_stops_nothing_and_the_hub_says_what_it_does_not_know(
    hub: Hub, cell: Run, other: Callable[..., OtherCell]
) -> None:
    two = other("two")
    hub.until_state("two", "ready")
    job = begin_motion(cell)
    two.proxy.cut()
    hub.until_state("two", "gone")
    answer = hub.stop("/cells/two/stop", deadline_s=0.2)
    assert not answer["at_rest"]
    assert "gone" in answer["robots"][0]["text"]
    assert "NOT known to be stopped" in answer["robots"][0]["text"]
    assert job_state(cell, job) == "running"
    two.proxy.mend()
    hub.until_state("two", "moving")
    # Both cells have the same arm: one command, an answer of each.
    answer = hub.stop("/stop")
    assert [(each["cell"], each["code"]) for each in answer["robots"]] == [("one", "ok"), ("two", "ok")]
    require_stopped(cell, job)


@pytest.mark.thorough
def test_a_cell_that_is_to_stop_without_the_hub_stops_once(
    hub: Hub, cell: Run, other: Callable[..., OtherCell]
) -> None:
    three = other("three", ", on_loss: stop, loss_s: 1.0")
    hub.until_state("three", "ready")
    job = begin_motion(cell)
    three.proxy.cut()
    require_stopped(cell, job)
    audit = three.folder / "logs" / f"{cell.name}.audit.jsonl"
    (line,) = until(lambda: audit.exists() and audit.read_text(encoding="utf-8").splitlines())
    assert json.loads(line)["who"] == "cobot"
    assert "no hub for 1 s" in json.loads(line)["details"]["command"]
    job = begin_motion(cell)  # it stops once, and people may move the arm without the hub
    time.sleep(1.5)  # longer than loss_s
    assert job_state(cell, job) == "running"
    three.proxy.mend()
    hub.stop("/cells/one/stop")


@pytest.mark.thorough
def test_a_frozen_cell_is_gone_and_a_killed_one_at_once(
    hub: Hub, cell: Run, other: Callable[..., OtherCell]
) -> None:
    four = other("four")
    hub.until_state("four", "ready")
    four.process.send_signal(signal.SIGSTOP)
    hub.until_state("four", "gone")
    four.process.send_signal(signal.SIGCONT)
    hub.until_state("four", "ready")
    four.process.kill()
    begun_s = time.monotonic()
    hub.until_state("four", "gone")
    assert time.monotonic() - begun_s < 2.0
    assert hub.robot("one")["alive"]


def test_a_name_that_is_used_twice_is_an_error_of_the_second_cell(
    hub: Hub, cell: Run, other: Callable[..., OtherCell]
) -> None:
    instance = hub.robot("one")["instance"]
    second = other("one")
    assert second.process.stdout is not None
    line = next(line for line in second.process.stdout if "ERROR" in line)
    assert "the name 'one' is used by another cell" in line
    assert "fleet.cell" in line
    until(lambda: not hub.robot("one")["used_twice"])
    assert hub.robot("one")["instance"] == instance


def test_a_killed_process_of_the_cell_is_replaced(hub: Hub, cell: Run) -> None:
    child = cell.child("cobot.fleet.cell")
    assert child is not None
    instance = hub.robot("one")["instance"]
    child.kill()
    until(lambda: hub.robot("one")["instance"] != instance and hub.robot("one")["state"] == "ready")
    assert hub.stop("/cells/one/stop")["at_rest"]


def test_a_killed_hub_stops_nothing_and_its_successor_knows_all(hub: Hub, cell: Run) -> None:
    job = begin_motion(cell)
    events = httpx.get(f"{hub.url}/cells/one/events").json()["events"]
    hub.end(signal.SIGKILL)
    assert job_state(cell, job) == "running"
    hub.start()
    hub.until_state("one", "moving")
    known = until(lambda: httpx.get(f"{hub.url}/cells/one/events").json()["events"])
    assert {event["id"] for event in events[-20:]} <= {event["id"] for event in known}
    assert hub.stop("/stop")["at_rest"]
    require_stopped(cell, job)


def test_two_hubs_are_an_error_of_the_second(hub: Hub, fleet: Any) -> None:
    there = f"tcp/127.0.0.1:{hub.zenoh_port}"
    here = f"tcp/127.0.0.1:{free_port()}"
    for options, words in (
        (("--listen", there, "--port", "0"), "another hub may be running here"),
        (("--listen", here, "--connect", there, "--port", "0"), "already has a hub"),
        (("--listen", here, "--port", str(hub.port)), "choose another port"),
    ):
        status, _, errors = fleet("serve", "--name", FLEET, *options)
        assert (status, words in errors) == (1, True), errors


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--host", "0.0.0.0"), "--host: 0.0.0.0 can be reached from other computers"),
        (("--listen", "tcp/0.0.0.0:7447"), "--listen: 0.0.0.0 can be reached from other computers"),
        (("--listen", "udp/127.0.0.1:7447"), "is not an address such as tcp/127.0.0.1:7447"),
        (("--listen", "tcp/127.0.0.1:99999"), "is not an address such as tcp/127.0.0.1:7447"),
        (("--name", "a/b"), "--name: 'a/b' is not valid"),
        (("--port", "99999"), "choose another port"),
    ],
)
def test_a_hub_with_wrong_options_does_not_start(fleet: Any, options: tuple[str, ...], words: str) -> None:
    status, _, errors = fleet("serve", *options)
    assert (status, words in errors) == (1, True), errors


def test_a_connection_without_a_request_is_closed(hub: Hub) -> None:
    with socket.create_connection(("127.0.0.1", hub.port), 60.0) as idle, idle.makefile("rb") as answer:
        received = answer.read()
    assert received.startswith(b"HTTP/1.1 408 "), received


def scouted(until_found: str) -> set[str]:
    """The sessions that answer a multicast, as soon as this one has, and 0.5 s more for the others."""
    scout = zenoh.scout(what="peer|router", config=zenoh.Config())
    found: set[str] = set()

    def look() -> bool:
        while (hello := scout.try_recv()) is not None:
            found.add(str(hello.zid))
        return until_found in found

    try:
        until(look)
        time.sleep(0.5)
        look()
    finally:
        scout.stop()
    return found


def test_the_hub_answers_no_multicast(hub: Hub, foreign: Any) -> None:
    """The control is a router with Zenoh's own settings, which answers."""
    (own,) = foreign.info.routers_zid()
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{free_port()}"]))
    with zenoh.open(config) as control:
        found = scouted(str(control.zid()))
    assert str(own) not in found


@pytest.mark.thorough
def test_a_cell_behind_a_router_of_another_maker_is_seen_and_stopped(
    hub: Hub, cell: Run, other: Callable[..., OtherCell]
) -> None:
    """The router is a plain session of Zenoh, which knows nothing of cobot."""
    port = free_port()
    config = zenoh.Config()
    for key, value in {
        "mode": "router",
        "listen/endpoints": [f"tcp/127.0.0.1:{port}"],
        "connect/endpoints": [f"tcp/127.0.0.1:{hub.zenoh_port}"],
        "scouting/multicast/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config):
        other("behind", port=port)
        hub.until_state("behind", "ready")
        job = begin_motion(cell)
        assert hub.stop("/cells/behind/stop")["at_rest"]
        require_stopped(cell, job)
    hub.until_state("behind", "gone")
    with zenoh.open(config):
        hub.until_state("behind", "ready")


def test_the_command_line_lists_shows_and_stops(hub: Hub, cell: Run, fleet: Any) -> None:
    status, listed, _ = fleet("list")
    assert status == 0
    assert re.search(rf"^one +{cell.name} +ready", listed, re.M)
    assert re.search(r"^mode +HOLD$", fleet("show", "one")[1], re.M)
    assert re.search(r"^counters +missed_cycles \d+, interventions \d+, stops", fleet("show", "one")[1], re.M)
    assert json.loads(fleet("show", "one", "--json")[1])["robots"][0]["mode"] == "HOLD"
    status, stopped, errors = fleet("stop", "one", "nowhere")
    assert status == 1
    assert f"one/{cell.name}: {cell.name}: nothing was running; the arm is at rest" in stopped
    assert "NOT stopped: there is no cell 'nowhere'" in errors
    assert fleet("stop", "one", "--robot", cell.name)[0] == 0
    assert fleet("stop")[0] == 2
    status, _, errors = fleet("list", "--url", "http://127.0.0.1:1")
    assert (status, "does not answer" in errors) == (1, True)


ESCAPES = "\x1b[2J\ntwo/arm ready\u202e<img src=x onerror=alert(1)>"


def test_a_hostile_cell_can_neither_forge_lines_nor_fill_the_hub_and_is_removed_when_gone(
    hub: Hub, cell: Run, foreign: Any, fleet: Any
) -> None:
    key = f"cobot/{FLEET}/evil/arm"
    state = {"cell": "evil", "robot": "arm", "instance": "0123456789abcdef", "version": "1"}
    state |= {"configuration": "", "state": "fault", "reason": ESCAPES, "job": "x" * 2000}
    programs = json.dumps([{"id": "a" * 2000, "label": "", "version": 1}] * 1000).encode()
    with foreign.declare_queryable(f"{key}/programs", lambda query: query.reply(f"{key}/programs", programs)):
        token = foreign.liveliness().declare_token(f"cobot/{FLEET}/evil/0123456789abcdef")

        def published() -> bool:
            foreign.put(f"{key}/state", json.dumps(state).encode())
            return bool(hub.robot("evil")["alive"])

        until(published)
        for changes in ({"reason": "y" * 1_000_000}, {"problems": ["z"] * 1000}):
            foreign.put(f"{key}/state", json.dumps(state | changes).encode())
        status, listed, _ = fleet("list")
        assert status == 0
        assert not [c for c in listed if not c.isprintable() and c != "\n"]
        assert sum(line.startswith("two") for line in listed.splitlines()) == 0
        assert max(map(len, listed.splitlines())) < 500
        assert "\x1b" not in fleet("show", "evil")[1]
        assert (hub.robot("evil")["reason"], hub.robot("evil")["problems"]) == (ESCAPES, [])
        answer = hub.http.get("/cells/evil/robots/arm/programs")
        assert (answer.status_code, "bytes" in answer.json()["detail"]) == (503, True)
        status, _, errors = fleet("forget", "evil")
        assert (status, "the cell evil is connected; end its process" in errors) == (1, True)
        token.undeclare()
    hub.until_state("evil", "gone")
    assert fleet("forget", "evil")[0] == 0
    assert hub.robot("evil")["state"] == "unknown"
    assert "there is no cell 'evil'" in fleet("forget", "evil")[2]


def test_watching_prints_changes(hub: Hub, cell: Run) -> None:
    watch = subprocess.Popen(
        [sys.executable, "-P", "-m", "cobot", "fleet", "watch", "--url", hub.url],
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background ignores it
    )
    try:
        assert watch.stdout is not None
        assert any(f"one/{cell.name}  ready" in line for line in watch.stdout)
    finally:
        watch.send_signal(signal.SIGINT)
        assert watch.wait(30.0) == 130
        watch.stdout.close()


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Origin": "http://evil.example"}, 403),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Host": "evil.example"}, 400),
    ],
)
def test_pages_of_other_sites_cannot_stop_the_fleet(hub: Hub, headers: dict[str, str], status: int) -> None:
    assert httpx.post(f"{hub.url}/stop", headers=headers).status_code == status


@pytest.mark.parametrize(
    ("path", "body", "status", "words"),
    [
        ("/stop", {"deadline_s": 0.0}, 422, "deadline_s: must be greater than 0"),
        ("/stop", {"id": "short"}, 422, "id: "),
        ("/stop", {"dedline_s": 1.0}, 422, "did you mean 'deadline_s'"),
        ("/cells/nowhere/stop", {}, 404, "there is no cell 'nowhere' in the fleet test-hall"),
        ("/cells/one/robots/nobody/stop", {}, 404, "the cell one has no robot 'nobody'; it has: "),
    ],
)
def test_a_wrong_request_is_an_error_with_a_reason(
    hub: Hub, cell: Run, path: str, body: dict[str, Any], status: int, words: str
) -> None:
    answer = httpx.post(f"{hub.url}{path}", json=body)
    assert (answer.status_code, words in answer.json()["detail"]) == (status, True), answer.text


@pytest.mark.thorough
@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not installed")
def test_the_page_shows_a_tile_and_stops_after_a_confirmation(hub: Hub, cell: Run, tmp_path: Path) -> None:
    job = begin_motion(cell)
    with browsing(tmp_path) as tools:
        page = Page(tools)
        page.visit(hub.url)
        wait_on(page, "document.querySelector('article[data-state=moving] h2')?.textContent === 'one'")
        page.click("#stop-all")
        wait_on(page, "document.querySelector('#confirm').open")
        page.click("#cancel")
        assert job_state(cell, job) == "running"
        page.click("article[data-state=moving] .stop")
        page.click("#sure")
        require_stopped(cell, job)
        wait_on(page, "document.querySelector('#result').textContent.includes('at rest')")
        alarms = "[...document.querySelectorAll('#alarms li')].map((each) => each.textContent)"
        alarm = f"{alarms}.some((each) => each.startsWith('one /'))"
        assert stop([cell.name], latched=True, out=io.StringIO())
        wait_on(page, f"{alarm} && /^\\(\\d+\\) /.test(document.title)")
        page.write("#find", "no such cell")  # a filter does not hide it
        wait_on(page, f"{alarm} && !document.querySelector('article[data-state=estop]')")
        shown = "(each) => each.textContent.startsWith('one /')"
        page.run(f"[...document.querySelectorAll('#alarms button')].find({shown}).click()")
        wait_on(page, "!!document.querySelector('article[data-state=estop]')")
        httpx.post(f"{cell.url}/robot/reset").raise_for_status()
        wait_on(page, f"!{alarm}")
        for language in ("de", "zh"):
            page.set_to("#language", language)
            wait_on(page, f"document.documentElement.lang === '{language}'")
            assert page.run("!document.body.innerText.match(/undefined|stop_all/)")
