"""What `cobot run` says when it cannot start: each sentence names the setting, or the place, to change.

Oracles: files, ports and processes that are in the way, made here.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from cobot_run import WAIT_S, unique_name

from cobot.config import Settings
from cobot.errors import SharedMemoryError
from cobot.ipc import memory_file, shm
from cobot.ipc.shm import RobotMemory
from cobot.launch.cli import main
from cobot.launch.process import RUN_MODULE, has_terminal
from cobot.launch.supervisor import Supervisor

pytestmark = pytest.mark.usefixtures("signals_and_log")

SMALL = "rt: {trajectory_capacity: 1000}\n"


@pytest.fixture
def name() -> Iterator[str]:
    robot = unique_name()
    yield robot
    Path(f"/dev/shm/cobot-{robot}").unlink(missing_ok=True)


def started(folder: Path, robot: str, text: str, capsys: pytest.CaptureFixture[str]) -> str:
    """What a start that fails says at its end."""
    text = text if "logs:" in text else f"{text}logs: logs\n"
    file = folder / "mine.yaml"
    file.write_text(f"{text}robot: {{name: {robot}}}\n" if "robot" not in text else text, encoding="utf-8")
    assert main(["run", "--config", str(file)]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("cobot: ")
    return last.removeprefix("cobot: ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("web: {host: 192.0.2.1}\n", r"web\.host: cannot listen on 192\.0\.2\.1 port 8007: Cannot assign"),
        (
            "web: {host: host.invalid}\n",
            r"web\.host: cannot listen on host\.invalid port 8007: .*; set an",
        ),
        ("web: {endpoints: no.yaml}\n", r"web\.endpoints: .*/no\.yaml: no such file"),
        ("web: {joint_limits: no.yaml}\n", r"web\.joint_limits: .*/no\.yaml: no such file"),
        ("robot: {model: no.xml}\n", r"robot\.model: .*/no\.xml: no such file"),
        ("robot: {srdf: no.srdf}\n", r"robot\.srdf: .*/no\.srdf: no such file"),
        ("robot: {srdf: mine.yaml}\n", r"robot\.srdf: .*/mine\.yaml: not a readable SRDF"),
        ("robot: {tcp: hand}\n", r"robot\.model: .*robot\.tcp: the model has no site or body 'hand'"),
        ("robot: {start_position: hom}\n", r"robot\.start_position: 'hom' is not in .*; valid names: home"),
        (
            "planning: {default_frame: moon}\n",
            r"planning\.default_frame: there is no frame 'moon'; valid",
        ),
        ("logs: mine.yaml/logs\n", r"logs: cannot write to .*/mine\.yaml/logs: Not a directory"),
        ("rt: {period_s: 1}\n", r".*/mine\.yaml: rt\.period_s: "),
        (
            "robots: [{name: a}, {name: a}]\n",
            r".*/mine\.yaml: robots\[1\]: robots\[0\] already has the name 'a'",
        ),
    ],
)
def test_what_the_settings_ask_for_and_cannot_be_had(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    if "host" not in text:
        text += "" if "web:" in text else "web: {port: 0}\n"
    assert re.match(message, started(tmp_path, name, text, capsys))


def test_a_port_in_use_is_that_of_web_port(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        said = started(tmp_path, name, f"web: {{port: {port}}}\n", capsys)
    assert said == (
        f"web.port: cannot listen on 127.0.0.1 port {port}: Address already in use; set another port, "
        "or --port 0, which picks a free port"
    )


def test_a_port_that_needs_a_privilege_is_that_of_web_port(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    said = started(tmp_path, name, "web: {port: 80}\n", capsys)
    assert said.startswith(
        "web.port: cannot listen on 127.0.0.1 port 80: Permission denied; set a port from 1024"
    )


def hold(robot: str, ready: Callable[[], None]) -> None:
    memory = RobotMemory.create(robot, 7, 0.001, 1000)
    ready()
    time.sleep(WAIT_S)
    memory.close()


def test_a_name_in_use_is_that_of_robot_name_with_who_has_it(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    context = multiprocessing.get_context("fork" if sys.version_info < (3, 12) else "spawn")
    ready = context.Event()
    other = context.Process(target=hold, args=(name, ready.set), daemon=True)
    other.start()
    try:
        assert ready.wait(WAIT_S)
        said = started(tmp_path, name, f"{SMALL}web: {{port: 0}}\n", capsys)
    finally:
        other.kill()
        other.join(WAIT_S)
    assert said == (
        f"robot '{name}' is in use: pid {other.pid} runs as its supervisor; stop it, or set another "
        "robot.name"
    )


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("", "cannot allocate .*; make room there, enlarge it .*, or lower rt.trajectory_capacity"),
        ("/no/such/folder", "No such file or directory; .* or set another robot.name"),
    ],
)
def test_shared_memory_that_cannot_be_made(
    name: str, monkeypatch: pytest.MonkeyPatch, place: str, message: str
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    if place:
        monkeypatch.setattr(memory_file, "FOLDER", Path(place))
    else:
        monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(SharedMemoryError, match=message):
        RobotMemory.create(name, 7, 0.001, 1000)


def test_a_folder_in_the_way_of_the_running_configuration_is_named(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    way = Path(f"/dev/shm/cobot-{name}.run")
    way.symlink_to(tmp_path)
    try:
        said = started(tmp_path, name, f"{SMALL}web: {{port: 0}}\n", capsys)
    finally:
        way.unlink()
    assert said.startswith(f"{way}: cannot be created: File exists")
    assert said.endswith("another robot.name")


@pytest.mark.parametrize(
    ("backend", "message"),
    [
        (
            "no.such:Arm",
            "robot.backend: cannot load 'no.such:Arm': ModuleNotFoundError: No module named 'no'",
        ),
        ("test_backend_of_start:Broken", "robot.backend: the controller at 10.0.0.5 does not answer"),
    ],
)
def test_an_rtloop_that_cannot_start_says_why_at_the_end(
    tmp_path: Path,
    name: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    backend: str,
    message: str,
) -> None:
    (tmp_path / "test_backend_of_start.py").write_text(
        "from rtloop.backends import BackendError\n"
        "def Broken(settings, limits):\n"
        "    raise BackendError('the controller at 10.0.0.5 does not answer')\n",
        encoding="utf-8",
    )
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(shm.__file__).parents[2]), str(tmp_path)]))
    text = f"rt: {{trajectory_capacity: 1000, backend: '{backend}'}}\nweb: {{enabled: false}}\n"
    said = started(tmp_path, name, f"{text}ros: {{enabled: false}}\n", capsys)
    assert said.startswith("rtloop ended with status 2 at its start: robot.backend: ")
    assert message in said


@pytest.mark.parametrize(
    ("module", "text", "message"),
    [
        ("rtloop", "", "is not running: there is no /dev/shm/cobot-"),
        (
            "cobot.dds",
            "ros: {localhost_only: false, interfaces: [no0]}",
            "ros.domain_id, ros.interfaces: .*no0",
        ),
    ],
)
def test_a_process_that_is_started_by_itself_says_what_it_lacks(
    tmp_path: Path, name: str, module: str, text: str, message: str
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(f"robot: {{name: {name}}}\n{text}\n", encoding="utf-8")
    command = [*RUN_MODULE, module, "--config", str(file)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert ended.returncode == 2
    assert re.search(message, ended.stdout)


def test_a_process_without_a_terminal_knows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(*_: object) -> int:
        raise OSError(6, "No such device or address")

    monkeypatch.setattr(os, "open", gone)
    assert not has_terminal()


def test_a_hangup_is_the_end_only_where_the_terminal_has_gone(
    settings: Settings, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    supervisor = Supervisor(settings, None)
    for before, now, ends in ((False, False, False), (True, True, False), (True, False, True)):
        supervisor._in_terminal = before
        monkeypatch.setattr("cobot.launch.supervisor.supervisor.has_terminal", lambda now=now: now)
        with caplog.at_level(logging.INFO):
            supervisor._reload([])
        assert supervisor._signals.stopping == ends
    assert "web.enabled is false: no service can read the configuration again" in caplog.text
