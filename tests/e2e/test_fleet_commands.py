"""A fleet with certificates: what a hub tells a cell to do, and who may.

Oracles: the service of the cell, with its jobs and its audit; a plain session of Zenoh with the certificate
of another cell, which knows only docs/fleet.md; Chromium.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
import yaml
from chromium import Page, browsing
from cobot_run import Run, answering, until
from fleets import FLEET, Hub, free_port
from folders import ROOT
from matplotlib.image import imread
from mcap.reader import make_reader
from network_namespaces import connect, hosts
from slow_relay import Faults, SlowRelay

from cobot.access.roles import Role
from cobot.access.tokens import TokenFile
from cobot.client import Client
from cobot.config import load_settings
from cobot.fleet.__main__ import main

if importlib.util.find_spec("zenoh") is None:
    pytest.skip("Zenoh is not installed: it is in the extra fleet", allow_module_level=True)
import zenoh

from cobot.fleet.bundles import Installed
from cobot.fleet.certificates import issue_cell, issue_hub, make_authority

HUB_ADDRESS = "10.9.1.1"
"""Of the hub that is on a computer of its own, see `network_namespaces.connect`."""
HOME = [0.0, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0]
SLOW = {"waypoints": [{"joints": HOME, "speed": 0.02}, {"joints": [1.0, *HOME[1:]], "speed": 0.02}]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("fleet") / "certificates"
    make_authority(made, FLEET)
    issue_hub(made, ["localhost", "127.0.0.1", HUB_ADDRESS], 30)
    for cell in ("one", "two"):
        issue_cell(made, cell, 30)
    return made


@pytest.fixture(scope="module")
def tokens(folder: Path) -> dict[str, str]:
    file = TokenFile(folder / "tokens.json")
    roles = {"ada": Role.OPERATOR, "bob": Role.OBSERVER, "eve": Role.ADMIN}
    return {name: file.create(name, role) for name, role in roles.items()}


@pytest.fixture(scope="module")
def hub(folder: Path, tokens: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hub]:
    started = Hub(folder, tokens["ada"], tmp_path_factory.mktemp("recordings"))
    yield started
    started.close()


@pytest.fixture(scope="module")
def cell(hub: Hub, folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    fleet = (
        f"{{name: {FLEET}, cell: one, zone: north, connect: ['{hub.address}'], "
        f"certificates: {folder}/cells/one, recordings: true, "
        "accept: {speed: admin, roll_out: operator, settings: admin}}"
    )
    run = Run(tmp_path_factory.mktemp("cell"), clock="realtime", more=f"fleet: {fleet}\n")
    with answering(run) as started:
        with Client(started.url) as client:
            client.save_program("slow", "Slow", SLOW)
        started.until(lambda: hub.robot("one")["state"] == "ready" and programs_at(hub, "one"))
        yield started


def programs_at(hub: Hub, cell: str) -> list[str]:
    """The programs that the hub's page offers."""
    robot = hub.robot(cell)["robot"]
    answer = hub.http.get(f"/cells/{cell}/robots/{robot}/programs")
    return [each["id"] for each in answer.json().get("programs", ())]


@pytest.fixture
def client(cell: Run, hub: Hub) -> Iterator[Client]:
    with Client(cell.url) as made:
        yield made
        hub.http.post("/cells/one/stop").raise_for_status()
        until(lambda: not made.jobs(5, "queued", "planning", "running", "paused"))


def order(hub: Hub, kind: str, path: str = "/cells/one", **options: Any) -> dict[str, Any]:
    """The answer of the only robot."""
    body = {"action": {"kind": kind} | options.pop("action", {})} | options.pop("body", {})
    answer = hub.http.post(f"{path}/commands", json=body, **options)
    assert answer.status_code == 200, answer.text
    (robot,) = answer.json()["robots"]
    return dict(robot)


def start_slow(hub: Hub) -> dict[str, Any]:
    """Start the slow program, and wait until the hub shows that it moves the arm."""
    found = order(hub, "start", action={"program": "slow"})
    until(lambda: hub.robot("one")["state"] == "moving" and hub.robot("one")["program"])
    return found


def audited(client: Client, command: str) -> list[dict[str, Any]]:
    entries = client._json("GET", "/audit")["entries"]
    return [each for each in entries if each.get("details", {}).get("command") == command]


def test_a_program_is_started_paused_resumed_and_stopped(hub: Hub, cell: Run, client: Client) -> None:
    started = start_slow(hub)
    assert (started["code"], started["text"]) == ("ok", "started slow, version 1")
    (job,) = (each["id"] for each in client.jobs(5, "running") if each["kind"] == "sequence")
    assert order(hub, "pause")["text"] == f"paused {job}"
    hub.until_state("one", "paused")
    assert client.job(job).state == "paused"
    assert order(hub, "resume")["text"] == f"resumed {job}"
    until(lambda: client.job(job).state == "running")
    assert hub.http.post("/zones/north/stop").json()["at_rest"]
    assert until(lambda: client.job(job).state == "cancelled")
    (entry,) = until(lambda: audited(client, started["id"]))
    assert (entry["who"], entry["from"], entry["what"]) == ("ada", "fleet", f"start {cell.name} slow")


def test_a_start_that_is_repeated_starts_once(hub: Hub, client: Client) -> None:
    first = start_slow(hub)
    body = {"id": first["id"]}
    again = order(hub, "start", action={"program": "slow"}, body=body)
    assert (first["code"], first["repeated"], again["repeated"]) == ("ok", False, True)
    assert again["text"] == first["text"], "a second start would be refused: only one runs at a time"
    other = order(hub, "pause", body=body)
    assert (other["code"], "another command already used this id" in other["text"]) == ("conflict", True)


def test_control_of_the_fleet_keeps_others_from_moving(hub: Hub, cell: Run, client: Client) -> None:
    assert order(hub, "take_control")["code"] == "ok"
    assert client.who_controls()["holder"] == "fleet"
    refused = httpx.post(f"{cell.url}/robot/move/joints", json={"joints": HOME}, timeout=30.0)
    assert refused.status_code == 409
    assert start_slow(hub)["code"] == "ok"
    hub.http.post("/cells/one/stop").raise_for_status()
    assert order(hub, "release_control")["code"] == "ok"
    until(lambda: not client.who_controls()["held"])


def test_control_that_a_killed_process_had_is_given_back(hub: Hub, cell: Run, client: Client) -> None:
    assert order(hub, "take_control")["code"] == "ok"
    child = cell.child("cobot.fleet.cell")
    assert child is not None
    child.kill()
    until(lambda: not client.who_controls()["held"])
    until(lambda: hub.robot("one")["state"] == "ready")
    assert order(hub, "take_control")["code"] == "ok"
    assert order(hub, "release_control")["code"] == "ok"


def test_cobot_check_looks_at_the_certificate(cell: Run, folder: Path, tmp_path: Path) -> None:
    config = tmp_path / "settings.yaml"
    config.write_text(cell.config.read_text().replace(f"{folder}/cells/one", f"{folder}/cells/nowhere"))
    command = [sys.executable, "-P", "-m", "cobot.fleet.cell", "--check", "--config"]
    good = subprocess.run([*command, str(cell.config)], capture_output=True, text=True, check=False)
    assert (good.returncode, FLEET in good.stdout) == (0, True), good.stderr
    bad = subprocess.run([*command, str(config)], capture_output=True, text=True, check=False)
    assert (bad.returncode, "cells/nowhere/ca.pem: cannot be read" in bad.stderr) == (2, True)
    assert "Traceback" not in bad.stderr


@pytest.mark.parametrize(
    ("kind", "action", "code", "words"),
    [
        (
            "speed",
            {"fraction": 0.5},
            "forbidden",
            "from admin (fleet.accept.speed), but ada has",
        ),
        ("start", {"program": "nothing"}, "not_found", "nothing"),
        ("start", {"program": "slow", "version": 7}, "not_found", "7"),
        ("pause", {}, "conflict", "nothing is running"),
        ("resume", {}, "conflict", "nothing is paused"),
    ],
)
def test_what_cannot_be_done_is_refused_with_a_reason(
    hub: Hub, client: Client, kind: str, action: dict[str, Any], code: str, words: str
) -> None:
    answer = order(hub, kind, action=action)
    assert (answer["code"], words in answer["text"]) == (code, True), answer
    assert until(lambda: audited(client, answer["id"]))[0]["outcome"] == code
    assert client.speed_override() == 1.0


def test_an_observer_may_stop_and_nothing_else(hub: Hub, client: Client, tokens: dict[str, str]) -> None:
    bob = {"headers": {"Authorization": f"Bearer {tokens['bob']}"}}
    answer = order(hub, "start", action={"program": "slow"}, **bob)
    assert (answer["code"], "bob has the role observer" in answer["text"]) == ("forbidden", True)
    assert order(hub, "stop", **bob)["code"] == "ok"


@pytest.mark.parametrize(
    ("path", "body", "status", "words"),
    [
        ("/commands", {"action": {"kind": "dance"}}, 422, "kind 'dance' is unknown; valid values: 'stop', "),
        ("/commands", {"action": {"kind": "speed", "fraction": 1.5}}, 422, "less than or equal to 1"),
        ("/commands", {"action": {"kind": "start", "program": "../up"}}, 422, "program"),
        ("/zones/south/commands", {"action": {"kind": "pause"}}, 404, "zones: north"),
    ],
)
def test_a_wrong_command_is_an_error(
    hub: Hub, cell: Run, path: str, body: dict[str, Any], status: int, words: str
) -> None:
    answer = hub.http.post(path, json=body)
    assert (answer.status_code, words in answer.json()["detail"]) == (status, True), answer.text


@pytest.mark.parametrize("token", ["", "Bearer cobot_wrong", "Basic YTpi"])
def test_without_a_token_the_hub_tells_and_does_nothing(hub: Hub, token: str) -> None:
    for method, path in (("GET", "/cells"), ("GET", "/metrics"), ("POST", "/stop")):
        answer = hub.http.request(method, path, headers={"Authorization": token})
        assert (answer.status_code, "a valid token is needed" in answer.text) == (401, True)
    assert hub.http.get("/", headers={"Authorization": token}).status_code == 200, "the page asks for it"


def test_a_body_that_is_too_large_and_an_observers_bundle_are_refused(
    hub: Hub, tokens: dict[str, str]
) -> None:
    for path, limit in (("/bundles", 8 * 2**20), ("/stop", 2 * 2**20)):
        answer = hub.http.post(path, content=iter([b" " * 2**20] * 9))
        assert (answer.status_code, f"more than {limit} bytes" in answer.text) == (413, True), answer.text
    bob = {"Authorization": f"Bearer {tokens['bob']}"}
    answer = hub.http.post("/bundles", content=b"{}", headers=bob)
    assert (answer.status_code, "a bundle needs the role operator" in answer.text) == (403, True)


def session_of(folder: Path, cell: str, address: str) -> Any:
    """A session with the certificate of a cell, which knows nothing of cobot."""
    tls, own = "transport/link/tls", folder / "cells" / cell
    config = zenoh.Config()
    for key, value in {
        "mode": "client",
        "connect/endpoints": [address],
        "connect/timeout_ms": 500,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        f"{tls}/root_ca_certificate": str(own / "ca.pem"),
        f"{tls}/enable_mtls": True,
        f"{tls}/connect_certificate": str(own / "cell.pem"),
        f"{tls}/connect_private_key": str(own / "cell.key"),
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def test_a_cell_can_neither_command_another_one_nor_speak_for_it(hub: Hub, cell: Run, folder: Path) -> None:
    two = session_of(folder, "two", hub.address)
    try:
        (time_,) = [json.loads(bytes(r.ok.payload)) for r in two.get(f"cobot/{FLEET}/@hub/time") if r.ok]
        times = {"epoch": time_["epoch"], "issued_s": time_["time_s"], "expires_s": time_["time_s"] + 10.0}
        whom = {"fleet": FLEET, "cell": "one", "robot": "*", "who": "ada", "role": "admin"}
        forged = {"id": os.urandom(8).hex(), "action": {"kind": "stop"}, **times, **whom}
        key = f"cobot/{FLEET}/one/{cell.name}/command"
        assert not list(two.get(key, payload=json.dumps(forged).encode(), timeout=1.0))
        state = {**hub.robot("one"), "mode": "FAULT"}
        for extra in ("alive", "age_s", "used_twice"):
            del state[extra]
        two.put(f"cobot/{FLEET}/one/{cell.name}/state", json.dumps(state).encode())
        time.sleep(0.3)
        assert hub.robot("one")["mode"] == "HOLD"
    finally:
        two.close()


def test_who_has_no_certificate_of_the_fleet_does_not_connect(hub: Hub, tmp_path: Path) -> None:
    make_authority(tmp_path, "other")
    issue_cell(tmp_path, "one", 30)
    with pytest.raises(zenoh.ZError):
        session_of(tmp_path, "one", hub.address)
    with pytest.raises(zenoh.ZError):
        session_of(tmp_path, "one", hub.address.replace("tls", "tcp"))


def test_metrics_are_those_of_the_page(hub: Hub, cell: Run) -> None:
    order(hub, "stop")
    text = hub.http.get("/metrics").text
    assert 'cobot_fleet_robots{state="ready"} 1.0' in text
    assert 'cobot_fleet_commands_total{action="stop",code="ok"}' in text
    assert f'cobot_fleet_state_age_seconds{{cell="one",robot="{cell.name}"}}' in text
    assert f'cobot_fleet_robot_counter{{cell="one",counter="stops",robot="{cell.name}"}}' in text


def test_the_command_line_commands_with_a_token(
    hub: Hub,
    client: Client,
    folder: Path,
    tokens: dict[str, str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COBOT_CERTIFICATE", str(folder / "ca.pem"))
    given = ("--url", hub.url, "--token", tokens["ada"])
    assert main(["run", "one", "--program", "slow", *given]) == 0
    assert "started slow, version 1" in capsys.readouterr().out
    for words, status, said in (
        (("pause", "--zone", "north"), 0, "paused "),
        (("resume", "--all"), 0, "resumed "),
        (("stop", "one"), 0, "at rest"),
        (("speed", "one", "--fraction", "0.5"), 1, "not done: this cell accepts this command from admin"),
        (("control", "one", "--take"), 0, "the fleet has control"),
        (("control", "one", "--release"), 0, "the fleet does not have control"),
    ):
        assert main([*words, *given]) == status, capsys.readouterr()
        assert said in capsys.readouterr().out
    assert main(["list", "--url", hub.url, "--token", "wrong"]) == 1
    assert "a valid token is needed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--listen", "tcp/127.0.0.1:7447"), "is not an address such as tls/127.0.0.1:7447"),
        (("--certificates", "/nowhere"), "/nowhere"),
    ],
)
def test_a_hub_with_wrong_certificates_does_not_start(
    folder: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], words: str
) -> None:
    listen = f"tls/127.0.0.1:{free_port()}"
    given = ["--listen", listen, "--certificates", str(folder), "--port", "0", *options]
    assert main(["serve", *given]) == 1
    assert words in capsys.readouterr().err


@pytest.mark.thorough
@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not installed")
def test_the_page_asks_for_a_token_and_starts_a_program(
    hub: Hub, client: Client, tokens: dict[str, str], tmp_path: Path
) -> None:
    with browsing(tmp_path, "--ignore-certificate-errors") as tools:
        page = Page(tools)

        def wait_on(script: str) -> None:
            until(lambda: page.run(script), lambda: f": {script}")

        page.ask(
            "Emulation.setDeviceMetricsOverride", width=1280, height=800, deviceScaleFactor=1, mobile=False
        )
        page.visit(hub.url)
        wait_on("document.querySelector('#login').open")
        page.write("#token", "wrong")
        page.click("#enter")
        wait_on("document.querySelector('#login').open && !document.querySelector('#wrong-token').hidden")
        page.write("#token", tokens["ada"])
        page.click("#enter")
        wait_on("document.querySelector('article[data-state=ready] h2')?.textContent === 'one'")
        page.click(".commands summary")
        wait_on("document.querySelector('[data-kind=start]').disabled === false")
        page.click("[data-kind=start]")
        wait_on("document.querySelector('#question').textContent.includes('The arm moves')")
        page.click("#sure")
        wait_on("document.querySelector('#result').textContent.includes('started slow')")
        until(lambda: [each for each in client.jobs(5, "running") if each["kind"] == "sequence"])
        page.click("[data-kind=pause]")
        wait_on("document.querySelector('article').dataset.state === 'paused'")
        page.click("article .look")
        wait_on("document.querySelector('#picture-shown').naturalWidth === 640")
        page.click("#picture-close")
        page.click("article .stop")
        page.click("#sure")
        wait_on("document.querySelector('#result').textContent.includes('at rest')")
        for language in ("de", "zh"):
            page.set_to("#language", language)
            wait_on(f"document.documentElement.lang === '{language}'")
            assert page.run("!document.body.innerText.match(/undefined|take_control/)")


def test_a_picture_of_the_arm_comes_on_request(
    hub: Hub,
    client: Client,
    folder: Path,
    tokens: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Oracle: matplotlib reads it, and it differs after a motion."""
    monkeypatch.setenv("COBOT_CERTIFICATE", str(folder / "ca.pem"))
    path = f"/cells/one/robots/{hub.robot('one')['robot']}/picture"
    first = hub.http.get(path)
    assert (first.status_code, first.headers["content-type"]) == (200, "image/png"), first.text
    assert imread(io.BytesIO(first.content)).shape[:2] == (480, 640)
    joints = client.joint_states()["position"]
    client.move_joints([joints[0] + 0.5, *joints[1:]], speed=0.5)
    file = tmp_path / "arm.png"
    assert main(["show", "one", "--picture", str(file), "--url", hub.url, "--token", tokens["ada"]]) == 0
    assert imread(file).shape[:2] == (480, 640)
    assert file.read_bytes() != first.content
    assert hub.http.get("/cells/one/robots/none/picture").status_code == 404


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    """A folder with a new program, another version of a stored one, and a position."""
    folder = tmp_path / "seams"
    (folder / "programs").mkdir(parents=True)
    (folder / "programs" / "slow.json").write_text(json.dumps(SLOW).replace("0.02", "0.03"))
    (folder / "programs" / "seam.lua").write_text("move_named('home')")
    (folder / "positions.json").write_text(json.dumps({"seam": [0.1, *HOME[1:]]}))
    return folder


@pytest.fixture
def roll_out(hub: Hub, folder: Path, tokens: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("COBOT_CERTIFICATE", str(folder / "ca.pem"))
    given = ("--version", "1.4", "--watch", "0.2", "--url", hub.url, "--token")
    return lambda bundle, who="ada": main(["roll-out", str(bundle), "one", *given, tokens[who]])


def programs_of(client: Client) -> dict[str, str]:
    return {each["id"]: client.program(each["id"])["text"] for each in client.programs()}


def test_a_bundle_is_rolled_out_watched_for_drift_and_rolled_back(
    hub: Hub, client: Client, bundle: Path, roll_out: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    before = programs_of(client)
    assert roll_out(bundle) == 0, capsys.readouterr()
    assert "activated seams 1.4" in capsys.readouterr().out
    assert set(programs_of(client)) == {*before, "seam"}
    assert "0.03" in programs_of(client)["slow"]
    assert {"name": "seam", "joints": [0.1, *HOME[1:]]}.items() <= client.positions()[-1].items()
    shown = until(lambda: hub.robot("one")["bundle"] and hub.robot("one"))
    assert shown["bundle"].startswith("seams 1.4 (")
    assert roll_out(bundle) == 0
    assert "is active already" in capsys.readouterr().out
    base = client.program("seam")["version"]
    client.save_program("seam", "Seam", "move_named('ready')", kind="lua", base=base)
    until(lambda: hub.robot("one")["drift"] == ["seam"])
    name = hub.http.get("/roll-outs").json()["roll_outs"][-1]["bundle"]
    assert order(hub, "roll_back", action={"bundle": name})["text"] == "rolled back seams 1.4"
    assert programs_of(client) == before
    assert "seam" not in [each["name"] for each in client.positions()]
    assert order(hub, "roll_back", action={"bundle": name})["code"] == "not_found"


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("programs/slow.json", "{", "program slow: "),
        ("programs/seam.lua", "move_named('home'", "program seam: "),
        ("positions.json", '{"seam": [0.1]}', "position seam: has 1 joints, but this robot has 7"),
        ("positions.json", '{"seam": [9, 0, 0, 0, 0, 0, 0]}', "position seam"),
        ("positions.json", '{"home": [0, 0, 0, 0, 0, 0, 0]}', "is part of the robot's SRDF"),
    ],
)
def test_a_bundle_that_does_not_fit_changes_nothing(
    client: Client,
    bundle: Path,
    roll_out: Any,
    capsys: pytest.CaptureFixture[str],
    file: str,
    text: str,
    words: str,
) -> None:
    before = programs_of(client), client.positions()
    (bundle / file).write_text(text)
    assert roll_out(bundle) == 1
    out = capsys.readouterr().out
    assert words in out, out
    assert "seams 1.4: refused" in out
    assert (programs_of(client), client.positions()) == before


@pytest.fixture
def with_settings(bundle: Path, client: Client) -> Path:
    """A bundle that also halves the velocity of the first joint, and changes a margin."""
    settings = bundle / "settings"
    settings.mkdir()
    limits = shipped_limits()
    limits["joint1"]["max_velocity"] *= 0.5
    (settings / "slower.yaml").write_text(yaml.safe_dump({"joint_limits": limits}))
    content = {"web": {"joint_limits": "slower.yaml"}, "planning": {"collision_margin_m": 0.011}}
    (settings / "settings.yaml").write_text(yaml.safe_dump(content))
    return bundle


def shipped_limits() -> dict[str, Any]:
    file = ROOT / "cobot" / "shipped" / "config" / "joint_limits.yaml"
    return dict(yaml.safe_load(file.read_text())["joint_limits"])


def velocity_limit(client: Client) -> float:
    return float(client._json("GET", "/robot/geometry")["joints"][0]["max_velocity"])


@pytest.mark.thorough
def test_settings_are_rolled_out_and_back(
    hub: Hub,
    cell: Run,
    client: Client,
    with_settings: Path,
    tokens: dict[str, str],
    roll_out: Any,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Oracle: the limits that the service reports, and the user's own file."""
    limit, own = velocity_limit(client), cell.config.read_text()
    configuration = hub.robot("one")["configuration"]
    assert roll_out(with_settings) == 1
    assert (
        "accepts settings from admin (fleet.accept.settings), but the role is operator"
        in capsys.readouterr().out
    )
    assert velocity_limit(client) == limit
    assert roll_out(with_settings, "eve") == 0, capsys.readouterr()
    said = capsys.readouterr().out
    assert "staged seams 1.4: 2 programs, 1 positions, settings" in said
    assert "restart the cell for: planning.collision_margin_m: 0.005 → 0.011" in said
    assert velocity_limit(client) == 0.5 * limit
    assert cell.config.read_text() == own
    until(lambda: "needs a restart of this cell" in str(hub.robot("one")["problems"]))
    assert hub.robot("one")["configuration"] != configuration
    assert client.reload()["taken_over"] == [], "a reload of the cell keeps them"
    name = hub.http.get("/roll-outs").json()["roll_outs"][-1]["bundle"]
    refused = order(hub, "roll_back", action={"bundle": name})
    assert "accepts settings from admin" in refused["text"]
    eve = {"Authorization": f"Bearer {tokens['eve']}"}
    assert "rolled back seams 1.4" in order(hub, "roll_back", action={"bundle": name}, headers=eve)["text"]
    assert velocity_limit(client) == limit
    until(lambda: hub.robot("one")["configuration"] == configuration)


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("settings.yaml", "web: {tokens: mine.json}", "web: unknown key 'tokens'"),
        ("settings.yaml", "fleet: {accept: {settings: observer}}", "unknown key 'fleet'"),
        ("settings.yaml", "web: {joint_limits: /etc/passwd}", "must be a file next to settings.yaml"),
        ("settings.yaml", "planning: {workers: many}", "planning.workers"),
        ("slower.yaml", "joint_limits: {}", "settings: "),
    ],
)
def test_settings_that_do_not_fit_change_nothing(
    client: Client,
    with_settings: Path,
    roll_out: Any,
    capsys: pytest.CaptureFixture[str],
    file: str,
    text: str,
    words: str,
) -> None:
    before = velocity_limit(client), programs_of(client)
    (with_settings / "settings" / file).write_text(text)
    assert roll_out(with_settings, "eve") != 0
    said = capsys.readouterr()
    assert words in said.out + said.err
    assert (velocity_limit(client), programs_of(client)) == before


@pytest.mark.thorough
def test_nothing_is_activated_while_a_program_runs(
    hub: Hub, client: Client, bundle: Path, roll_out: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    before = programs_of(client)
    assert start_slow(hub)["code"] == "ok"
    assert roll_out(bundle) == 1
    assert "the arm must be at rest" in capsys.readouterr().out
    assert programs_of(client) == before


def test_a_killed_cell_undoes_what_it_had_begun(hub: Hub, cell: Run, client: Client) -> None:
    """The state on disk is what a kill between two programs leaves."""
    child = cell.child("cobot.fleet.cell")
    assert child is not None
    client.save_program("half", "Half", SLOW)
    begun = Installed(
        bundle="0" * 64,
        title="half 1",
        versions={},
        programs_before={"half": None},
        positions_before={},
        complete=False,
    )
    load_settings(cell.config).bundle_file.write_text(begun.model_dump_json())
    child.kill()
    until(lambda: "half" not in [each["id"] for each in client.programs()])
    until(lambda: not load_settings(cell.config).bundle_file.exists())


@pytest.mark.thorough
def test_recordings_come_home_over_a_kill_of_the_hub(
    hub: Hub,
    cell: Run,
    client: Client,
    folder: Path,
    tokens: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source = load_settings(cell.config).recording_folder
    until(lambda: client.recordings()["recorder"]["alive"])
    names = client.record("dump", 1.0)
    hub.end(signal.SIGKILL)
    names += client.record("dump", 1.0)
    hub.start()
    assert hub.recordings is not None
    home = hub.recordings / "one" / cell.name
    for name in names:
        until(lambda: (home / name).exists())  # noqa: B023 - it is done before the next one
        assert (home / name).read_bytes() == (source / name).read_bytes()
    reader = make_reader(io.BytesIO((home / names[0]).read_bytes()))
    about = {each.name: each.metadata for each in reader.iter_metadata()}
    assert about["foxglove"] == {"deviceName": cell.name, "key": f"{cell.name}-{Path(names[0]).stem}"}
    monkeypatch.setenv("COBOT_CERTIFICATE", str(folder / "ca.pem"))
    given = ["pull", str(tmp_path / "here"), "one", "--url", hub.url, "--token", tokens["ada"]]
    part = tmp_path / "here" / "one" / cell.name / f"{names[0]}.part"
    part.parent.mkdir(parents=True)
    part.write_bytes((source / names[0]).read_bytes()[:1000])  # of a call that was interrupted
    assert main(given) == 0
    assert (part.parent / names[0]).read_bytes() == (source / names[0]).read_bytes()
    assert main(given) == 0
    assert "0 new" in capsys.readouterr().out
    refused = hub.http.get(f"/recordings/one/{cell.name}/..%2F..%2F..%2Ftokens.json")
    assert refused.status_code == 404


@pytest.mark.thorough
def test_a_broken_cable_stops_nothing_and_delays_no_stop_to_later(
    cell: Run, folder: Path, tokens: dict[str, str], client: Client, tmp_path: Path
) -> None:
    """Packets vanish without an end of the connection. Oracle: Linux's network namespaces."""
    with hosts(2) as (plant, here):
        connect(plant, here, 1)
        with plant.inside():
            far = Hub(folder, tokens["ada"], host=HUB_ADDRESS)
        fleet = (
            f"fleet: {{name: {FLEET}, cell: two, connect: ['{far.address}'], "
            f"certificates: {folder}/cells/two}}\n"
        )
        config = tmp_path / "two.yaml"
        config.write_text(cell.config.read_text().split("fleet:")[0] + fleet)
        with here.inside():
            process = subprocess.Popen([sys.executable, "-P", "-m", "cobot.fleet.cell", "--config", config])
        try:
            client.run_program("slow")
            with plant.inside():
                far.until_state("two", "moving")
            here.ip("link", "set", "net1", "down")
            with plant.inside():
                far.until_state("two", "gone")
                answer = far.stop("/stop", deadline_s=0.5)
                assert not answer["at_rest"]
                assert "NOT known to be stopped" in answer["robots"][0]["text"]
            here.ip("link", "set", "net1", "up")
            with plant.inside():
                far.until_state("two", "moving")
                assert far.stop("/stop")["at_rest"]
        finally:
            process.kill()
            process.wait()
            with plant.inside():
                far.close()


@pytest.mark.thorough
@pytest.mark.parametrize(
    "faults",
    [
        Faults(delay_s=0.15),
        Faults(rate=100_000),
        Faults(loss=0.05, stall_s=0.3),
        Faults(delay_s=0.05, rate=200_000, loss=0.02, stall_s=0.3),
    ],
    ids=["delay", "narrow line", "loss", "all of them"],
)
def test_a_bad_network_delays_states_repeats_no_command_and_keeps_the_deadline_of_a_stop(
    hub: Hub,
    cell: Run,
    folder: Path,
    tokens: dict[str, str],
    client: Client,
    tmp_path: Path,
    faults: Faults,
) -> None:
    """Oracle: a relay in front of the hub, and the audit of the cell. This kernel has no netem."""
    relay = SlowRelay(hub.zenoh_port, faults)
    fleet = (
        f"fleet: {{name: {FLEET}, cell: two, connect: ['tls/127.0.0.1:{relay.port}'], "
        f"certificates: {folder}/cells/two}}\n"
    )
    config = tmp_path / "two.yaml"
    config.write_text(cell.config.read_text().split("fleet:")[0] + fleet)
    command = [sys.executable, "-P", "-m", "cobot.fleet.cell", "--config", str(config), "--url", cell.url]
    process = subprocess.Popen(command)
    ended = threading.Event()
    try:
        hub.until_state("two", "ready")
        instance = hub.robot("two")["instance"]
        ages, ids = [], []
        with ThreadPoolExecutor(9) as pool:
            for number in range(8):
                ids.append(f"speed-{number}-{os.urandom(4).hex()}")
                action = {"kind": "speed", "fraction": 0.9 + 0.01 * number}
                body = {"id": ids[-1], "action": action, "deadline_s": 10.0}
                # A client that repeats its request because no answer has come.
                asked = [pool.submit(hub.http.post, "/cells/two/commands", json=body) for _ in range(3)]
                codes = [each.result().json()["robots"][0]["code"] for each in asked]
                assert codes == ["ok"] * 3
                ages.append(hub.robot("two")["age_s"])
            audit = load_settings(config).audit_file.read_text(encoding="utf-8")
            assert [audit.count(each) for each in ids] == [1] * len(ids), "each one is executed once"
            assert max(ages) < 2.0, "states keep coming"
            url = hub.http.post("/cells/two/panel").json()["url"]
            loads = [pool.submit(_load, hub, f"{url}panel/words.json", ended) for _ in range(6)]
            time.sleep(0.5)  # until pieces are on their way
            client.run_program("slow")
            until(lambda: client.jobs(5, "running"))
            begun_s = time.monotonic()
            stopped = hub.stop("/cells/two/stop")
            took_s = time.monotonic() - begun_s
            ended.set()
            print(f"stop {took_s:.2f} s, states {max(ages):.2f} s old, {relay.stalls} stalls")
            assert stopped["at_rest"]
            assert not client.jobs(5, "running")
            assert took_s < 2.0, "the deadline, although a panel is being loaded"
            for each in loads:
                each.result()
        assert hub.robot("two")["instance"] == instance, "the connection has held"
    finally:
        ended.set()
        process.kill()
        process.wait()
        relay.close()
        client.set_speed_override(1.0)
    until(lambda: not hub.robot("two")["alive"])


def _load(hub: Hub, url: str, ended: threading.Event) -> int:
    """Load a large file again and again. Returns how often."""
    count = 0
    while not ended.is_set():
        count += hub.http.get(url).status_code == 200
    return count


def _accepted(url: str, body: dict[str, Any]) -> Any:
    """The answer to a POST; None if it is not accepted yet."""
    answer = httpx.post(url, json=body, timeout=30.0)
    return answer.json() if answer.status_code == 200 else None


def modules_of(cell: psutil.Process) -> dict[str, psutil.Process]:
    """The processes of a cell, by the modules that they run."""
    found = {}
    for each in cell.children():
        with contextlib.suppress(psutil.NoSuchProcess, psutil.ZombieProcess):
            words = each.cmdline()
            if words[1:3] == ["-P", "-m"]:
                found[words[3]] = each
    return found


@pytest.mark.thorough
def test_the_example_of_three_cells(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """As its header says. A cell, each process of a cell, and the hub come back after a kill while the others
    go on, and all recordings come home."""
    example = ROOT / "examples" / "fleet"
    process = subprocess.Popen(
        [sys.executable, "-P", str(example / "start.py")],
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        assert process.stdout is not None
        said = next(line for line in process.stdout if line.startswith("export "))
        for each in said.split()[1:]:
            monkeypatch.setenv(*each.split("=", 1))

        def listed() -> list[dict[str, Any]]:
            capsys.readouterr()
            return [] if main(["list", "--json"]) else json.loads(capsys.readouterr().out)["robots"]

        def robots() -> dict[str, str]:
            return {each["cell"]: each["state"] for each in listed()}

        until(lambda: robots() == {"one": "ready", "two": "ready", "three": "ready"})
        cells = ["one", "two", "three"]
        given = ["--version", "1", "--wave", "2", "--watch", "0"]
        until(lambda: main(["roll-out", str(example / "seams"), *cells, *given]) == 0)
        assert "wave 2 of 2: two/arm-two, three/arm-three" in capsys.readouterr().out
        assert main(["run", "--zone", "south", "--program", "seam"]) == 0
        assert capsys.readouterr().out.count("started seam, version 1") == 2
        until(lambda: [robots().get(name) for name in ("two", "three")] == ["moving", "moving"])
        commands = {str(each.cmdline()): each for each in psutil.Process(process.pid).children()}
        next(each for words, each in commands.items() if "/three.yaml" in words).kill()
        until(lambda: robots().get("three") in ("gone", "silent"))
        assert robots().get("one") == "ready"
        assert main(["stop", "one", "two"]) == 0
        until(lambda: robots().get("three") == "ready")
        assert main(["roll-out", str(example / "seams"), *cells, *given]) == 0
        assert capsys.readouterr().out.count("is active already") == 3
        two = next(each for words, each in commands.items() if "/two.yaml" in words)
        modules = modules_of(two)
        assert {"app", "rtloop", "cobot.fleet.cell"} <= set(modules)
        for module, old in modules.items():
            old.kill()
            until(lambda module=module, old=old: modules_of(two).get(module, old) != old)
            until(lambda: robots() == {"one": "ready", "two": "ready", "three": "ready"})
        until(lambda: main(["run", "two", "--program", "seam"]) == 0)
        until(lambda: robots().get("two") == "moving")
        assert main(["stop", "two"]) == 0
        names = set()
        for each in listed():
            service = f"{each['panel']}/robots/{each['robot']}/recordings"
            dump = {"action": "dump", "seconds": 0.5}
            answer = until(lambda service=service, dump=dump: _accepted(service, dump))
            names |= {f"{each['cell']}/{each['robot']}/{name}" for name in answer["names"]}
        assert len(names) == 3
        next(each for words, each in commands.items() if "'serve'" in words).kill()
        home = tmp_path / "home"
        until(
            lambda: (
                main(["pull", str(home)]) == 0
                and names <= {str(each.relative_to(home)) for each in home.rglob("*.mcap")}
            )
        )
        assert set(robots().values()) == {"ready"}
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(60.0)
        process.stdout.close()
