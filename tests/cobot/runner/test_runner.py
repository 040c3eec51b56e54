"""The runner against a service of which only the answers are known: return codes, order, log, progress.

Oracle: the standard library's HTTP server records what arrives; rosbags' own reader opens the recording.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from cobot_run import WAIT_S
from rosbags.highlevel import AnyReader
from thorough import few

JOINTS = {"joints": [0, 0, 0, -1.57, 0, 1.57, 0]}
STATE = {"name": ["joint1"], "position": [0.1], "velocity": [0.2], "effort": [0.3]}
ARRIVED = {"success": True, "message": "", "code": None, "motion_id": 7, "duration_s": 0.1}


class Service(ThreadingHTTPServer):
    """Answers what it is told to; `posted` holds (path, token, body) of all motions."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Answering)
        self.posted: list[tuple[str, str | None, dict[str, Any]]] = []
        self.answers: list[tuple[int, dict[str, Any]]] = []
        self.delay_s = 0.0

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class Answering(BaseHTTPRequestHandler):
    server: Service

    def do_GET(self) -> None:
        self._answer(200, STATE)

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.server.posted.append((self.path, self.headers["X-Motion-Token"], body))
        time.sleep(self.server.delay_s)
        self._answer(*(self.server.answers.pop(0) if self.server.answers else (200, ARRIVED)))

    def _answer(self, status: int, content: dict[str, Any]) -> None:
        payload = json.dumps(content).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(payload)))
        self.end_headers()
        self.wfile.write(payload)

    def log_message(self, *_: object) -> None: ...


@pytest.fixture
def service() -> Iterator[Service]:
    made = Service()
    thread = threading.Thread(target=made.serve_forever)
    thread.start()
    yield made
    made.shutdown()
    thread.join()
    made.server_close()


def run(tmp_path: Path, url: str, content: object, *arguments: str, **kwargs: Any) -> Any:
    file = tmp_path / "sequence.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    command = [sys.executable, "-m", "cobot.runner", "run", str(file), "--url", url, *arguments]
    environment = {**os.environ, "COBOT_MOTION_TOKEN": "secret"}
    return subprocess.run(
        command, capture_output=True, text=True, timeout=WAIT_S, check=False, env=environment, **kwargs
    )


def test_home_and_waypoints_are_visited_in_order_in_each_iteration(tmp_path: Path, service: Service) -> None:
    content = {"home": {"named": "home"}, "waypoints": [{**JOINTS, "label": "there", "speed": 0.7}]}
    result = run(tmp_path, service.url, content, "--iterations", "2")
    assert result.returncode == 0
    assert [path for path, _, _ in service.posted] == ["/robot/move/named", "/robot/move/joints"] * 2
    assert {token for _, token, _ in service.posted} == {"secret"}
    assert service.posted[1][2] == {**JOINTS, "speed": 0.7, "accel_scale": 0.0}
    assert "iteration 2/2, waypoint 1/1 (there): arrived after 0.10 s" in result.stdout
    assert result.stdout.splitlines()[-1].endswith(" done")


def test_waypoints_with_a_radius_are_one_motion_with_the_next(tmp_path: Path, service: Service) -> None:
    content = {
        "home": {"named": "home", "radius": 0.1},
        "waypoints": [{**JOINTS, "radius": 0.05}, JOINTS, JOINTS],
    }
    result = run(tmp_path, service.url, content)
    assert result.returncode == 0
    (first, _, body), (second, _, _) = service.posted
    assert (first, second) == ("/robot/move/sequence", "/robot/move/joints")
    assert body == {"motions": [{"name": "home"}, JOINTS, JOINTS], "radii": [0.1, 0.05]}
    assert "iteration 1/1, waypoint 2/3, through home on without a stop: arrived" in result.stdout


def test_the_first_failure_ends_the_sequence(tmp_path: Path, service: Service) -> None:
    service.answers = [
        (200, ARRIVED),
        (200, {**ARRIVED, "success": False, "message": "too far", "code": "unreachable"}),
    ]
    result = run(tmp_path, service.url, {"waypoints": [JOINTS] * 5})
    assert result.returncode == 3
    assert len(service.posted) == 2
    assert "error: sequence.json: iteration 1/1, waypoint 2/5: too far" in result.stdout


@pytest.mark.parametrize(
    ("status", "code", "returncode"),
    few([(422, "limit", 2), (409, "conflict", 3), (503, "unavailable", 4), (500, "error", 3)]),
)
def test_refusals_have_return_codes(
    tmp_path: Path, service: Service, status: int, code: str, returncode: int
) -> None:
    service.answers = [(status, {"detail": "the reason", "code": code})]
    result = run(tmp_path, service.url, {"waypoints": [JOINTS]})
    assert result.returncode == returncode
    assert "the reason" in result.stdout


def test_without_a_service_the_runner_says_so(tmp_path: Path, service: Service) -> None:
    result = run(tmp_path, "http://127.0.0.1:1", {"waypoints": [JOINTS]})
    assert result.returncode == 4
    assert "error: " in result.stdout
    assert "Traceback" not in result.stdout + result.stderr


@pytest.mark.parametrize(
    "arguments", [("--iterations", "0"), ("--delay", "nan"), ("--delay", "-1"), ("--topics", "/tf")]
)
def test_wrong_arguments_are_refused_before_anything_moves(
    tmp_path: Path, service: Service, arguments: tuple[str, ...]
) -> None:
    result = run(tmp_path, service.url, {"waypoints": [JOINTS]}, *arguments)
    assert result.returncode == 2
    assert not service.posted


def test_progress_is_reported_on_the_pipe(tmp_path: Path, service: Service) -> None:
    read_end, write_end = os.pipe()
    with os.fdopen(read_end) as pipe:
        result = run(
            tmp_path,
            service.url,
            {"waypoints": [JOINTS] * 2},
            "--progress-fd",
            str(write_end),
            pass_fds=(write_end,),
        )
        os.close(write_end)
        events = [json.loads(line) for line in pipe]
    assert result.returncode == 0
    assert [event["waypoint"] for event in events] == [1, 2]
    place = {"iteration": 1, "n_iterations": 1, "waypoint": 1, "n_waypoints": 2}
    end = {"asking": False, "within": False}
    assert events == [
        {**place, "step": "waypoint 1/2", "share": 0.0, "behind": 0, **end},
        {**place, "waypoint": 2, "step": "waypoint 2/2", "share": 0.5, "behind": 1, **end},
    ]


def test_a_runner_asks_before_each_motion_and_goes_where_it_is_told(tmp_path: Path, service: Service) -> None:
    read_end, write_end = os.pipe()
    answers_end, answering_end = os.pipe()
    chain = [{"joints": [n], "radius": 0.1 * (n == 2)} for n in range(1, 5)]
    for answer in (None, 3, 2, None):  # in the midst of the chain of 2 and 3 too; then nobody answers
        os.write(answering_end, json.dumps({"waypoint": answer}).encode() + b"\n")
    os.close(answering_end)
    pipes = ("--progress-fd", str(write_end), "--answers-fd", str(answers_end))
    with os.fdopen(read_end) as pipe:
        result = run(tmp_path, service.url, {"waypoints": chain}, *pipes, pass_fds=(write_end, answers_end))
        os.close(write_end)
        os.close(answers_end)
        events = [json.loads(line) for line in pipe]
    assert result.returncode == 0, result.stdout
    moves = [[m["joints"] for m in body.get("motions", [body])] for _, _, body in service.posted]
    assert moves == [[[1]], [[3]], [[2], [3]], [[4]]]
    asked = [(event["waypoint"], event["behind"]) for event in events if event["asking"]]
    assert asked == [(1, 0), (3, 1), (4, 3), (4, 3)]


def test_a_failed_motion_is_in_the_recording_with_its_reason(tmp_path: Path, service: Service) -> None:
    service.answers = [(200, {**ARRIVED, "success": False, "message": "too far", "code": "unreachable"})]
    bag = tmp_path / "bag%2e%2e"  # which is a name like any other
    assert run(tmp_path, service.url, {"waypoints": [JOINTS]}, "--bag", str(bag)).returncode == 3
    with AnyReader([bag]) as reader:
        events = [
            json.loads(reader.deserialize(raw, connection.msgtype).data)
            for connection, _, raw in reader.messages()
            if connection.topic == "/motion_events"
        ]
    assert [event["event"] for event in events] == ["start", "failed"]
    assert events[1]["reason"] == "too far"


def test_a_bag_that_exists_is_not_overwritten(tmp_path: Path, service: Service) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    result = run(tmp_path, service.url, {"waypoints": [JOINTS]}, "--bag", str(bag))
    assert result.returncode == 2
    assert "cannot be written" in result.stdout
    assert not service.posted
    assert not list(bag.iterdir())


def test_a_recording_that_the_disk_has_no_room_for_ends_alone(tmp_path: Path, service: Service) -> None:
    """A limit on the size of files stands for a full disk: the kernel refuses to write in both cases."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))

    content = {"waypoints": [JOINTS] * 3}
    result = run(tmp_path, service.url, content, "--bag", str(tmp_path / "bag"), preexec_fn=limit)
    assert result.returncode == 0, result.stdout + result.stderr
    assert len(service.posted) == 3
    assert f"the recording ended with: bag {tmp_path / 'bag'}: cannot be written: " in result.stdout
    assert "Traceback" not in result.stdout + result.stderr


def test_a_recording_where_nothing_can_be_written_is_refused_before_anything_moves(
    tmp_path: Path, service: Service
) -> None:
    result = run(tmp_path, service.url, {"waypoints": [JOINTS]}, "--bag", "/proc/bag")
    assert result.returncode == 2
    assert "bag /proc/bag: cannot be written" in result.stdout
    assert not service.posted


def test_a_file_may_come_through_standard_input(service: Service) -> None:
    command = [sys.executable, "-m", "cobot.runner", "run", "-", "--url", service.url]
    content = json.dumps({"waypoints": [JOINTS]})
    result = subprocess.run(
        command, input=content, capture_output=True, text=True, timeout=WAIT_S, check=False
    )
    assert result.returncode == 0
    assert len(service.posted) == 1


def test_a_motion_is_waited_for_as_long_as_it_is_said(tmp_path: Path, service: Service) -> None:
    service.delay_s = 1.0
    late = run(tmp_path, service.url, {"waypoints": [JOINTS]}, "--motion-timeout", "0.1")
    assert late.returncode == 4
    assert "timed out" in late.stdout
    assert run(tmp_path, service.url, {"waypoints": [JOINTS]}, "--motion-timeout", "30").returncode == 0
