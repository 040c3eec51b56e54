"""A service with HTTPS that asks for tokens, and all of its own processes and clients at it.

Oracles: openssl's certificate, bytes on a socket, the table of processes, exit statuses.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
from certificates import certificate
from chromium import CHROMIUM, Page, browsing
from cobot_run import WAIT_S, Run, answering, until
from dds_peers import own_domain
from floods import HANDSHAKES, flooding
from ros_peer import Peer
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.aubo.interfaces import interface_definitions
from cobot import Mode, Robot
from cobot.access.roles import Role
from cobot.access.tokens import TokenFile
from cobot.client import Client
from cobot.client.tls import tls_context
from cobot.codes import Code
from cobot.errors import AuthenticationError, PermissionDenied, UnavailableError
from cobot.ros.messages import Messages

OPERATION = "#operations-robot-joint_states"
# It asks twice for what its starter may not do, and says what it is told.
CAREFUL = """
local allowed, why = pcall(robot.call, "RobotConfig", "resetLimits")
textmsg("limits", allowed, why)
textmsg("dof", robot.call("RobotConfig", "getDof"))
require("ros_bind").ros_subscriber_factory("/rosout", "rcl_interfaces/msg/Log")
textmsg("subscribed")
"""


class Locked:
    """The service, a token of each role, the certificate, and somebody on ROS 2."""

    def __init__(self, run: Run, file: TokenFile, tokens: dict[Role, str], trusted: Path, peer: Peer) -> None:
        self.run, self.file, self.tokens, self.trusted, self.peer = run, file, tokens, trusted, peer

    def client(self, role: Role) -> Client:
        return Client(self.run.url, token=self.tokens[role], verify=self.trusted)


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Locked]:
    folder = tmp_path_factory.mktemp("locked")
    trusted = certificate(folder, "service")
    file = TokenFile(folder / "tokens.json")
    tokens = {role: file.create(f"the-{role.name.lower()}", role) for role in Role if role}
    web = (
        ", authentication: required, tokens: tokens.json, stop_without_token: false"
        ", tls_certificate: service.pem, tls_key: service.key"
    )
    asking = {
        "headers": {"Authorization": f"Bearer {tokens[Role.ADMIN]}"},
        "verify": tls_context(trusted),
    }
    with (
        own_domain() as domain,
        Peer(domain, Messages(interface_definitions())) as peer,
        answering(
            Run(folder, clock="realtime", ros_domain=domain, ros_access="auto", web=web, asking=asking)
        ) as run,
    ):
        yield Locked(run, file, tokens, trusted, peer)


def test_the_start_says_what_is_in_force_and_check_looks_at_it(locked: Locked) -> None:
    run = locked.run
    assert f"access     with a token, {len(locked.tokens)} in " in run.output
    over_ros = "; over ROS 2 every participant on this computer observes only (ros.access: auto)"
    assert over_ros in run.output
    assert run.url.startswith("https://localhost:")
    command = [sys.executable, "-m", "cobot", "check", "--config", str(run.config)]
    checked = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert f"ok      access: https, tokens needed, {len(locked.tokens)} in " in checked.stdout, checked.stderr
    assert over_ros in checked.stdout
    for token in locked.tokens.values():
        assert token not in run.output + checked.stdout


def test_python_s_clients_need_the_token_and_the_certificate(
    locked: Locked, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = locked.run.url
    with locked.client(Role.OBSERVER) as observer:
        assert len(observer.joint_states()["position"]) == 7
        assert observer.stop()["success"], "whoever may look may stop"
        with pytest.raises(PermissionDenied, match="needs the role operator"):
            observer.move_named("home")
    with Client(url, verify=locked.trusted) as nobody, pytest.raises(AuthenticationError):
        nobody.health()
    with Client(url) as distrustful, pytest.raises(UnavailableError, match="certificate"):
        distrustful.health()
    with pytest.raises(AuthenticationError):
        Robot(url, verify=locked.trusted, verbose=False)
    monkeypatch.setenv("COBOT_TOKEN", locked.tokens[Role.OPERATOR])
    monkeypatch.setenv("COBOT_CERTIFICATE", str(locked.trusted))
    with Client(url) as operator:
        operator.move_named("home", speed=1.0)
    for name in (url, locked.run.name):
        with Robot(name, verbose=False) as robot:
            robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
            with robot.start_joint_impedance_control() as control:
                control.set_target_joints(control.get_state().q)
            robot.stop()


def test_a_token_on_the_wire_is_encrypted_and_plain_http_gets_nothing(locked: Locked) -> None:
    host, port = locked.run.url.removeprefix("https://").split(":")
    with socket.create_connection((host, int(port)), timeout=WAIT_S) as plain:
        plain.sendall(b"GET /health HTTP/1.1\r\nHost: localhost\r\n\r\n")
        with contextlib.suppress(ConnectionError):
            assert b"HTTP/1.1 200" not in plain.recv(4096)
    context = tls_context(locked.trusted)
    with socket.create_connection((host, int(port))) as raw, context.wrap_socket(raw) as secure:
        assert (secure.version() or "") >= "TLSv1.2"


@pytest.mark.thorough
def test_a_flood_of_handshakes_keeps_nobody_from_stopping(locked: Locked) -> None:
    service = locked.run.child("app")
    with flooding(locked.run.url, HANDSHAKES), locked.client(Role.OBSERVER) as stopper:
        time.sleep(0.5)
        assert stopper.stop()
        assert locked.run.health()
    assert locked.run.child("app") == service
    assert "Traceback" not in locked.run.output


@pytest.mark.thorough
def test_the_button_of_the_documentation_shows_the_token(locked: Locked, tmp_path: Path) -> None:
    """In Chromium, as a user would: Swagger UI sends what was typed into it."""
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    with browsing(tmp_path, "--ignore-certificate-errors") as tools:
        page = Page(tools)

        def found(selector: str) -> str:
            return f"document.querySelector({json.dumps(selector)})"

        def press(selector: str, shown: str) -> None:
            """Until it has had its effect: Swagger UI may not listen yet."""
            click = f"{found(selector)}?.click()"
            until(lambda: page.run(f"!!{shown} || ({click}, false)") or time.sleep(0.5))

        def status() -> str:
            """Of the answer that the page shows."""
            loading = found(f"{OPERATION} .loading-container")
            press(f"{OPERATION} .execute", f"({loading} || {answer})")
            return str(until(lambda: page.run(answer))).split()[0]

        answer = f"{found(f'{OPERATION} .live-responses-table tr.response .response-col_status')}?.innerText"
        page.visit(f"{locked.run.url}/docs")
        press(f"{OPERATION} .opblock-summary-control", found(f"{OPERATION} .execute"))
        assert status() == "401"
        press(f"{OPERATION} .btn-clear", f"!{answer}")
        press(".btn.authorize", found("#auth-bearer-value"))
        page.run(f"{found('#auth-bearer-value')}.focus()")
        page.ask("Input.insertText", text=locked.tokens[Role.OBSERVER])
        press(".auth-btn-wrapper .authorize", found(".btn.authorize.locked"))
        assert status() == "200"


@pytest.mark.thorough
def test_the_panel_asks_for_the_token_and_keeps_it(locked: Locked, tmp_path: Path) -> None:
    """Also in a small window that shows the guide and who has stopped the arm."""
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    with locked.client(Role.OBSERVER) as observer:
        observer.stop()
    with browsing(tmp_path, "--ignore-certificate-errors", "--enable-unsafe-swiftshader") as tools:
        page = Page(tools)
        page.ask(
            "Emulation.setDeviceMetricsOverride", width=800, height=600, deviceScaleFactor=1, mobile=False
        )
        page.visit(f"{locked.run.url}/")
        until(lambda: page.run("document.querySelector('#token-form').checkVisibility()"))
        page.run("document.querySelector('#token').focus()")
        page.ask("Input.insertText", text=locked.tokens[Role.OBSERVER])
        assert page.run("document.querySelector('#banner').hidden"), "nobody is silent"
        page.click("#use-token")
        until(lambda: page.run("!!window.cobotPanel?.state && !!document.querySelector('[data-jog=joint]')"))
        assert not page.run("document.querySelector('#token-form').checkVisibility()")

        until(lambda: page.run("cobotPanel.stream.ready && !document.querySelector('#guide').hidden"))
        until(lambda: page.run("!document.querySelector('#halt').hidden"))
        page.click("#guide-skip")
        assert page.run("document.querySelector('#guide').hidden")
        place = page.place('[data-jog="joint"]')
        page.mouse("mousePressed", place)
        refused = "document.querySelector('#jog-why').innerText.includes('role does not permit')"
        until(lambda: page.run(refused))
        page.mouse("mouseReleased", place)
        assert page.run(refused), "the reason is gone after the release"


@pytest.mark.thorough
def test_an_administrator_adds_and_deletes_tokens_in_the_panel(locked: Locked, tmp_path: Path) -> None:
    """Oracle: whether the token opens REST, and the file of the tokens."""
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    with browsing(tmp_path, "--ignore-certificate-errors", "--enable-unsafe-swiftshader") as tools:
        page = Page(tools)

        def press(selector: str, effect: Callable[[], Any]) -> Any:
            """Press until this has an effect, because the page may move under the pointer."""

            def attempt() -> Any:
                page.click(selector)
                return next((found for _ in range(50) if (found := effect()) or time.sleep(0.1)), None)

            return until(attempt)

        def enter(role: Role) -> None:
            page.visit(f"{locked.run.url}/")
            page.run(f"sessionStorage.setItem('cobot.token', '{locked.tokens[role]}')")
            page.visit(f"{locked.run.url}/")
            until(lambda: page.run("!!window.cobotPanel?.state"))
            for part in ("setup", "people"):
                chosen = f"document.querySelector('#tab-{part}').ariaSelected === 'true'"
                press(f"#tab-{part}", partial(page.run, chosen))

        def fill(name: str, days: str, effect: Callable[[], Any]) -> Any:
            for field, text in (("name", name), ("days", days)):
                page.run(f"document.querySelector('#people-{field}').value = {json.dumps(text)}")
            return press("#people-add", effect)

        def says(text: str) -> bool:
            return text in page.run("document.querySelector('#people-why').textContent")

        def names() -> list[str]:
            return [each.name for each in locked.file.read()]

        enter(Role.OPERATOR)
        until(lambda: page.run("document.querySelector('#people-add').disabled"))
        assert "administrator" in page.run("document.querySelector('#people-add').title")
        assert not page.run("document.querySelector('#token-form').checkVisibility()")

        enter(Role.ADMIN)
        until(lambda: page.run("document.querySelectorAll('#people-list li').length") == len(names()))
        for name, days, text in (
            ("<b>x</b>", "", "letters from a to z"),
            ("the-admin", "", "the-admin already"),
            ("anna", "-1", "at most 36500"),
        ):
            fill(name, days, partial(says, text))
        token = fill("anna", "2", lambda: page.run("document.querySelector('#people-new').value"))
        with Client(locked.run.url, token=token, verify=locked.trusted) as anna:
            assert anna.health()
            press("#people-copy", lambda: says("Copied."))
            press("#people-done", lambda: page.run("document.querySelector('#people-new').value === ''"))
            assert page.run("document.querySelector('[data-token=the-admin] button').disabled")
            delete = "document.querySelector('[data-token=anna] button')"
            press("[data-token=anna] button", lambda: page.run(f"{delete}.textContent === 'Delete anna?'"))
            assert "anna" in names()
            press("[data-token=anna] button", lambda: says("anna is deleted"))
            assert "anna" not in names()
            with pytest.raises(AuthenticationError):
                anna.health()


def lua(locked: Locked, folder: Path, token: str | None) -> subprocess.CompletedProcess[str]:
    program = folder / "careful.lua"
    program.write_text(CAREFUL, encoding="utf-8")
    command = [sys.executable, "-m", "cobot", "lua", str(program), "--url", locked.run.url]
    command += ["--certificate", str(locked.trusted), *(["--token", token] if token else [])]
    environment = {name: value for name, value in os.environ.items() if name != "COBOT_TOKEN"}
    return subprocess.run(
        command, capture_output=True, text=True, timeout=WAIT_S, check=False, env=environment
    )


def test_a_lua_program_may_do_what_its_token_may(locked: Locked, tmp_path: Path) -> None:
    ended = lua(locked, tmp_path, locked.tokens[Role.OBSERVER])
    assert ended.returncode == 0, ended.stdout
    assert "limits false" in ended.stdout
    assert "this request needs the role programmer" in ended.stdout
    assert "dof 7" in ended.stdout
    assert "subscribed" in ended.stdout
    assert "limits true" in lua(locked, tmp_path, locked.tokens[Role.PROGRAMMER]).stdout
    assert lua(locked, tmp_path, None).returncode != 0


def test_a_program_that_the_service_runs_is_who_started_it_for_as_long_as_it_runs(locked: Locked) -> None:
    """The one uploads and may change limits; the other runs what is there, and its program may not."""
    source = CAREFUL + "sleep(1.5)\n"
    folder = locked.run.config.parent / "programs"
    folder.mkdir(exist_ok=True)
    (folder / "careful.lua").write_text(source, encoding="utf-8")
    said: dict[Role, str] = {}
    used: list[str] = []
    for role in (Role.PROGRAMMER, Role.OPERATOR):
        with locked.client(role) as client:
            if role is Role.PROGRAMMER:
                client.start_sequence(folder / "careful.lua", n_iterations=1)
            else:
                loaded = {"program": "careful.lua"}
                with pytest.raises(PermissionDenied, match="this request needs the role programmer"):
                    client.start_sequence(folder / "careful.lua")
                answers = [
                    client.call_service(locked.run.name, "RuntimeMachine", "loadProgram", loaded),
                    client.call_service(locked.run.name, "RuntimeMachine", "runProgram", {}),
                ]
                assert [answer["code"] for answer in answers] == [0, 0], answers
            pid = client.sequence_status()["pid"]
            used.append(psutil.Process(pid).environ()["COBOT_TOKEN"])
            assert "COBOT_ROS_TOKEN" not in psutil.Process(pid).environ()
            with Client(locked.run.url, token=used[-1], verify=locked.trusted) as itself:
                itself.health()
            locked.run.until(lambda client=client: client.sequence_status()["status"] == "finished")
            assert client.sequence_status()["returncode"] == 0, "\n".join(client.sequence_logs())
            said[role] = "\n".join(client.sequence_logs(8))
    assert "limits true" in said[Role.PROGRAMMER]
    assert "limits false" in said[Role.OPERATOR]
    assert "the-operator has the role operator" in said[Role.OPERATOR]
    for token in used:
        late = Client(locked.run.url, token=token, verify=locked.trusted)
        with late, pytest.raises(AuthenticationError):
            late.health()


def test_where_tokens_are_required_ros_observes_only(locked: Locked) -> None:
    """DDS has no tokens: a service that only reads is answered, one that moves is refused, and nothing
    listens for servo points."""
    name = f"/{locked.run.name}"

    def call(method: str, **request: Any) -> dict[str, Any]:
        short = method.split("/")[1]
        type_ = f"aubo_interfaces/srv/{short[0].upper()}{short[1:]}"
        answer: dict[str, Any] = locked.peer.client(f"{name}/{method}", type_).until_ready().call(request)
        return answer

    assert call("RobotConfig/getDof")["result"] == 7
    for method, role in (("MotionControl/stopJoint", "operator"), ("RobotConfig/resetLimits", "programmer")):
        refused = call(method)
        assert refused["code"] == Code.FORBIDDEN
        assert f"ros2 has the role observer, but this request needs the role {role}" in refused["message"]
    readers = {topic for kind, topic, _ in locked.peer.found if kind == "r"}
    assert f"rt{name}/joint_cmd" not in readers, "nothing listens for servo points"


def test_a_websocket_ends_with_its_token_and_its_address_is_in_no_log(locked: Locked) -> None:
    token = locked.file.create("passing", Role.OBSERVER)
    context = tls_context(locked.trusted)
    bearer = {"Authorization": f"Bearer {token}"}
    state = f"{locked.run.url}/robot/joint_states"
    # The service looks at the file every half second.
    locked.run.until(lambda: httpx.get(state, headers=bearer, verify=context, timeout=WAIT_S).is_success)
    url = locked.run.url.replace("https", "wss")
    with connect(f"{url}/rosbridge?token={token}", ssl=context) as socket_:
        socket_.send(json.dumps({"op": "call_service", "service": "/rosapi/nodes"}))
        assert json.loads(socket_.recv(WAIT_S))["result"]
        locked.file.revoke("passing")
        with pytest.raises(ConnectionClosed) as closed:
            socket_.recv(WAIT_S)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1008
    log_file = locked.run.config.parent / "logs" / f"{locked.run.name}.log"
    assert token not in locked.run.output + log_file.read_text(encoding="utf-8")


def test_a_certificate_that_is_wrong_is_said_before_anything_starts(tmp_path: Path) -> None:
    config = tmp_path / "settings.yaml"
    config.write_text(
        "web: {port: 0, tls_certificate: none.pem, tls_key: none.key}\nlogs: logs\n", encoding="utf-8"
    )
    command = [sys.executable, "-m", "cobot", "run", "--config", str(config)]
    started = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert started.returncode == 1
    assert "web.tls_certificate" in started.stderr
    assert "none.pem: cannot be read" in started.stderr


@pytest.mark.thorough
def test_beyond_this_computer_a_token_is_needed_unless_the_settings_say_otherwise(tmp_path: Path) -> None:
    """As bytes, as an attacker would: no browser, no library."""
    file = TokenFile(tmp_path / "tokens.json")
    token = file.create("somebody", Role.OBSERVER)
    asking = {"headers": {"Authorization": f"Bearer {token}"}}
    web = ", host: 0.0.0.0, tokens: tokens.json"
    with answering(Run(tmp_path, web=web, asking=asking)) as run:
        port = int(run.url.rsplit(":", 1)[1])

        def status(request: str) -> str:
            with socket.create_connection(("127.0.0.1", port), timeout=WAIT_S) as raw:
                raw.sendall(request.replace("\n", "\r\n").encode("latin-1"))
                return raw.recv(64).decode("latin-1").split(" ")[1]

        host = f"Host: 127.0.0.1:{port}\n"
        assert status(f"GET /robot/pose HTTP/1.1\n{host}\n") == "401"
        assert status(f"POST /robot/reset HTTP/1.1\n{host}\n") == "401"
        assert status(f"POST /stop HTTP/1.1\n{host}\n") == "200"
        assert status(f"POST /stop HTTP/1.1\n{host}Origin: http://evil.com\n\n") == "403"
        assert status("POST /stop HTTP/1.1\nHost: evil.com\n\n") == "421"
        assert status("POST /stop HTTP/1.0\n\n") == "400"
        assert status(f"POST /stop HTTP/1.1\n{host}Host: evil.com\n\n") in ("421", "400")
        assert status(f"GET /robot/pose HTTP/1.1\n{host}Authorization: Bearer {token}\n\n") == "200"
        assert status(f"GET /robot/pose HTTP/1.1\n{host}X-Forwarded-For: 127.0.0.1\n\n") == "401"
        assert httpx.get(f"http://127.0.0.1:{port}/docs").status_code == 200
