"""The Python client.

Oracles: the requests that arrive at a transport of the test, and the manual's paths, fields and defaults.
"""

from __future__ import annotations

import base64
import email
import email.policy
import json
import math
import socket
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest

from cobot.client import Client
from cobot.client.connection import ERRORS
from cobot.errors import CobotError, ExecutionError, InputError, UnavailableError

Handler = Callable[[httpx2.Request], httpx2.Response]
DONE = {"success": True, "message": "Motion completed successfully", "motion_id": 1, "duration_s": 1.0}
UP = {"x": 0, "y": 0, "z": 1}
SCALING = {"speed": 0.1, "accel_scale": 0.0}


def client(handler: Handler, **options: Any) -> Client:
    return Client("http://robot.test:8007", transport=httpx2.MockTransport(handler), **options)


def answering(content: Any, status: int = 200) -> Handler:
    return lambda request: httpx2.Response(status, json=content)


def subclasses(kind: type[CobotError]) -> Iterator[type[CobotError]]:
    yield kind
    for child in kind.__subclasses__():
        if child.__module__ == kind.__module__:  # another module's have no code of their own
            yield from subclasses(child)


def sent(call: Callable[[Client], Any], answer: Any = DONE, **options: Any) -> httpx2.Request:
    """The one request of a call."""
    requests: list[httpx2.Request] = []

    def record(request: httpx2.Request) -> httpx2.Response:
        request.read()
        requests.append(request)
        return httpx2.Response(200, json=answer)

    with client(record, **options) as robot:
        call(robot)
    assert len(requests) == 1
    return requests[0]


def form(request: httpx2.Request) -> dict[str, tuple[str | None, str]]:
    """Name -> (file name, content) of a multipart body, by the standard library's MIME parser."""
    head = f"Content-Type: {request.headers['content-type']}\r\n\r\n".encode()
    message = email.message_from_bytes(head + request.content, policy=email.policy.HTTP)
    parts = {}
    for part in message.iter_parts():
        name = part.get_param("name", header="content-disposition")
        parts[str(name)] = (part.get_filename(), str(part.get_content()).rstrip("\r\n"))
    return parts


@pytest.mark.parametrize(
    ("call", "method", "target", "answer"),
    [
        (Client.joint_states, "GET", "/robot/joint_states", {"name": []}),
        (Client.pose, "GET", "/robot/pose", {"position": {}}),
        (Client.state, "GET", "/robot/state", {"mode": "HOLD"}),
        (Client.positions, "GET", "/robot/positions", [{"name": "home"}]),
        (Client.sequence_status, "GET", "/sequences/status", {"status": "idle"}),
        (Client.stop, "POST", "/stop", {"success": True}),
        (Client.reset, "POST", "/robot/reset", {"success": True}),
        (Client.health, "GET", "/health", {"status": "ok"}),
    ],
)
def test_what_takes_no_arguments_returns_the_answer_as_it_is(
    call: Callable[[Client], Any], method: str, target: str, answer: Any
) -> None:
    results = []
    request = sent(lambda robot: results.append(call(robot)), answer)
    assert (request.method, request.url.raw_path.decode()) == (method, target)
    assert results == [answer]


@pytest.mark.parametrize(
    ("call", "target"),
    [
        (Client.joint_states, "/robots/left-2/joint_states"),
        (Client.stop, "/robots/left-2/stop"),
        (Client.sequence_status, "/robots/left-2/sequences/status"),
        (lambda robot: robot.move_named("home"), "/robots/left-2/move/named"),
        (lambda robot: robot.send_trajectory([]), "/robots/left-2/trajectory/send"),
    ],
)
def test_one_of_several_robots_is_asked_below_its_name(call: Callable[[Client], Any], target: str) -> None:
    assert sent(call, robot="left-2").url.raw_path.decode() == target
    requests: list[str] = []

    def record(request: httpx2.Request) -> httpx2.Response:
        requests.append(request.url.raw_path.decode())
        return httpx2.Response(200, json=DONE)

    with Client("http://robot.test:8007/robots/left-2/", transport=httpx2.MockTransport(record)) as robot:
        call(robot)
    assert requests == [target]


@pytest.mark.parametrize("call", [Client.trajectory_logs, Client.sequence_logs])
def test_logs_are_lists_of_lines(call: Callable[[Client, int], list[str]]) -> None:
    results = []
    request = sent(lambda robot: results.append(call(robot, 7)), {"lines": ["a", "b"]})
    assert dict(request.url.params) == {"limit": "7"}
    assert results == [["a", "b"]]


@pytest.mark.parametrize(
    ("call", "path", "body"),
    [
        (lambda robot: robot.move_named("home"), "named", {"name": "home", **SCALING}),
        (
            lambda robot: robot.move_joints((0, 1.5), speed=0.5, accel_scale=0.25),
            "joints",
            {"joints": [0, 1.5], "speed": 0.5, "accel_scale": 0.25},
        ),
        (
            lambda robot: robot.move_pose(x=0.4, y=0, z=0.5),
            "pose",
            {"x": 0.4, "y": 0, "z": 0.5, "a": 0, "b": 0, "c": 0, **SCALING}
            | {"planner": "ptp", "frame_id": "", "via": None},
        ),
        (
            lambda robot: robot.move_pose(
                x=1, y=2, z=3, a=4, b=5, c=6, planner="circ", frame_id="tool", via={"x": 1, "y": 2, "z": 3}
            ),
            "pose",
            {"x": 1, "y": 2, "z": 3, "a": 4, "b": 5, "c": 6, **SCALING}
            | {"planner": "circ", "frame_id": "tool", "via": {"x": 1, "y": 2, "z": 3}},
        ),
        (
            lambda robot: robot.move_pose(x=1, y=2, z=3, planner="lin", speed_m_s=0.2),
            "pose",
            {"x": 1, "y": 2, "z": 3, "a": 0, "b": 0, "c": 0, "accel_scale": 0}
            | {"planner": "lin", "frame_id": "", "via": None, "speed_m_s": 0.2},
        ),
        (
            lambda robot: robot.move_arc(centre={"x": 1, "y": 2, "z": 3}, axis=UP, angle=6.3, rise=0.1),
            "arc",
            {"centre": {"x": 1, "y": 2, "z": 3}, "axis": UP, "angle": 6.3, "rise": 0.1},
        ),
        (
            lambda robot: robot.move_sequence([{"name": "home"}, {"joints": [1.0]}], [0.1]),
            "sequence",
            {"motions": [{"name": "home"}, {"joints": [1.0]}], "radii": [0.1]},
        ),
    ],
)
def test_motions_send_the_manuals_fields_with_its_defaults(
    call: Callable[[Client], Any], path: str, body: dict[str, Any]
) -> None:
    request = sent(call)
    assert (request.method, request.url.path) == ("POST", f"/robot/move/{path}")
    assert json.loads(request.content) == body


def test_motions_have_their_own_timeout_and_carry_the_token() -> None:
    def named(robot: Client) -> Any:
        return robot.move_named("home")

    request = sent(named, timeout_s=1.0, motion_timeout_s=2.0, motion_token="secret")
    assert request.extensions["timeout"]["read"] == 2.0
    assert request.headers["x-motion-token"] == "secret"
    assert sent(Client.health, timeout_s=1.0).extensions["timeout"]["read"] == 1.0
    assert "x-motion-token" not in sent(named).headers


def test_the_access_token_is_the_one_given_or_the_environment_s(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COBOT_TOKEN", raising=False)
    assert "authorization" not in sent(Client.health).headers
    monkeypatch.setenv("COBOT_TOKEN", "of-the-environment")
    assert sent(Client.health).headers["authorization"] == "Bearer of-the-environment"
    assert sent(Client.health, token="given").headers["authorization"] == "Bearer given"
    monkeypatch.setenv("COBOT_TOKEN", "")
    assert "authorization" not in sent(Client.health).headers


def test_a_trajectory_is_sent_with_its_options() -> None:
    points = [{"positions": [0.0], "time_from_start": 1.0}]
    request = sent(lambda robot: robot.send_trajectory(points, retime=True))
    assert request.url.path == "/trajectory/send"
    assert json.loads(request.content) == {"points": points, "retime": True}


def test_files_are_uploaded_as_forms(tmp_path: Path) -> None:
    file = tmp_path / "points.csv"
    file.write_text("joint1;t\n", encoding="utf-8")
    request = sent(lambda robot: robot.send_csv(file, separator=";", validate_limits=False))
    assert request.url.path == "/trajectory/send_csv"
    assert dict(request.url.params) == {"separator": ";", "validate_limits": "false"}
    assert form(request) == {"file": ("points.csv", "joint1;t")}
    request = sent(lambda robot: robot.start_sequence(file, n_iterations=2, bag_path="a/b"))
    assert request.url.path == "/sequences/start"
    assert form(request)["config"][0] == "points.csv"
    assert form(request)["n_iterations"] == (None, "2")
    assert form(request)["bag_path"] == (None, "a/b")


def test_no_two_errors_share_a_code() -> None:
    kinds = list(subclasses(CobotError))
    assert len({kind.code for kind in kinds}) == len(kinds)
    assert set(ERRORS.values()) == set(kinds)


@pytest.mark.parametrize("kind", list(subclasses(CobotError)))
def test_every_error_of_the_service_arrives_as_its_own_class(kind: type[CobotError]) -> None:
    refused = answering({"detail": "the reason", "code": kind.code}, 409)
    failed = answering({"success": False, "message": "the reason", "code": kind.code})
    for call, handler in ((Client.health, refused), (lambda robot: robot.move_named("home"), failed)):
        with pytest.raises(kind, match=r"^the reason$") as caught:
            call(client(handler))
        assert type(caught.value) is kind


def test_codes_of_a_newer_service_are_still_errors() -> None:
    with pytest.raises(CobotError, match="why") as refused:
        client(answering({"detail": "why", "code": "new"}, 500)).health()
    assert type(refused.value) is CobotError
    for code in ({}, {"code": None}, {"code": "new"}):
        with pytest.raises(ExecutionError, match="why"):
            client(answering({"success": False, "message": "why", **code})).move_named("home")


@pytest.mark.parametrize(
    "response",
    [
        httpx2.Response(200, text="<html>"),
        httpx2.Response(200, json=[]),
        httpx2.Response(302, headers={"location": "/"}),
        httpx2.Response(404, json={"detail": "Not Found"}),
        httpx2.Response(404, json=["x"]),
        httpx2.Response(500, text="\xff"),
    ],
)
def test_another_server_at_the_address_is_no_robot(response: httpx2.Response) -> None:
    with pytest.raises(
        UnavailableError, match=r"GET http://robot\.test:8007/health: .*the answer does not come from cobot"
    ):
        client(lambda request: response).health()


@pytest.mark.parametrize("kind", [httpx2.ConnectError, httpx2.ReadTimeout, httpx2.RemoteProtocolError])
def test_a_failed_connection_is_unavailable_with_its_cause(kind: type[httpx2.TransportError]) -> None:
    def fail(request: httpx2.Request) -> httpx2.Response:
        raise kind("")

    with pytest.raises(UnavailableError, match=f"/health: {kind.__name__}") as caught:
        client(fail).health()
    assert isinstance(caught.value.__cause__, kind)


def test_a_stop_comes_again_until_it_is_answered() -> None:
    asked: list[str] = []

    def handler(request: httpx2.Request) -> httpx2.Response:
        asked.append(request.url.path)
        if len(asked) == 1:
            return httpx2.Response(503, json={"detail": "this had to make room", "code": "busy"})
        if len(asked) == 2:
            raise httpx2.RemoteProtocolError("closed before it was answered")
        return httpx2.Response(200, json=DONE)

    with client(handler) as robot:
        assert robot.stop() == DONE
        assert asked == ["/stop"] * 3
        asked.clear()
        with pytest.raises(UnavailableError, match="had to make room"):  # what else is asked comes once
            robot.health()
        assert asked == ["/health"]


def test_nobody_listening_is_unavailable() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound, but not listening
        with (
            Client(f"http://127.0.0.1:{taken.getsockname()[1]}") as robot,
            pytest.raises(UnavailableError, match="refused"),
        ):
            robot.health()


def test_the_proxy_of_the_environment_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """A proxy that does not exist would make every request fail in another way than this one."""
    monkeypatch.setenv("HTTP_PROXY", "http://proxy.invalid:1")
    monkeypatch.delenv("NO_PROXY", raising=False)
    monkeypatch.delenv("no_proxy", raising=False)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        with (
            Client(f"http://127.0.0.1:{taken.getsockname()[1]}") as robot,
            pytest.raises(UnavailableError, match="refused"),
        ):
            robot.health()


@pytest.mark.parametrize("joints", [[math.nan], [math.inf], [object()]])
def test_what_json_cannot_say_is_refused_before_it_is_sent(joints: list[Any]) -> None:
    with pytest.raises(InputError, match="POST /robot/move/joints"):
        client(answering(DONE)).move_joints(joints)


def test_a_url_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="url"):
        Client("http://a\x00b")
    with pytest.raises(InputError, match=r"url 'localhost:8007': .*; a valid one is http://localhost:8007"):
        Client("localhost:8007")


def test_how_to_plan_goes_with_a_motion_and_a_plan_with_its_number() -> None:
    moved = sent(lambda robot: robot.move_named("home", planner="ompl", algorithm="RRTstar"))
    assert json.loads(moved.content) == {"name": "home", **SCALING, "planner": "ompl", "algorithm": "RRTstar"}
    plan = sent(lambda robot: robot.plan("joints", joints=[0.1], start=[0.0]), {"plan_id": "1"})
    assert plan.url.path == "/robot/plan/joints"
    assert json.loads(plan.content) == {"joints": [0.1], "start": [0.0]}
    dry = sent(lambda robot: robot.rehearse("1"))
    assert (dry.method, dry.url.path) == ("POST", "/robot/plans/1/rehearse")
    run = sent(lambda robot: robot.execute("1"))
    assert (run.url.path, json.loads(run.content)) == ("/robot/execute", {"plan_id": "1"})


DOWNLOADS: list[Callable[[Client, Path], None]] = [
    lambda robot, file: robot.fetch_recording("log", file),
    Client.fetch_backup,
    Client.fetch_support,
]


@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
@pytest.mark.parametrize("name", ["backup.zip", "backup.zip.part"])
@pytest.mark.parametrize("download", DOWNLOADS)
def test_a_download_writes_through_no_link(
    tmp_path: Path, download: Callable[[Client, Path], None], name: str, link: Callable[[Path, Path], None]
) -> None:
    """Oracle: the file that the link leads to."""
    theirs, folder = tmp_path / "theirs", tmp_path / "folder"
    folder.mkdir()
    theirs.write_bytes(b"theirs")
    link(folder / name, theirs)
    with client(lambda request: httpx2.Response(200, content=b"new")) as robot:
        download(robot, folder / "backup.zip")
    assert theirs.read_bytes() == b"theirs"
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == {"backup.zip": b"new"}
    assert not (folder / "backup.zip").is_symlink()


@pytest.mark.parametrize("name", ["backup.zip", "backup.zip.part"])
def test_a_download_whose_name_is_a_folder_s_is_refused_and_the_folder_stays(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / name).mkdir()
    with (
        client(lambda request: httpx2.Response(200, content=b"new")) as robot,
        pytest.raises(InputError, match=r"backup\.zip: cannot be written: Is a directory"),
    ):
        robot.fetch_backup(tmp_path / "backup.zip")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).is_dir()


def test_a_broken_download_leaves_the_file_that_was_there(tmp_path: Path) -> None:
    """Also where its name is a link: the link stays, and what it leads to."""

    def broken() -> Iterator[bytes]:
        yield b"half"
        raise httpx2.ReadError("gone")

    theirs, file = tmp_path / "theirs", tmp_path / "backup.zip"
    theirs.write_bytes(b"theirs")
    file.symlink_to(theirs)
    with (
        client(lambda request: httpx2.Response(200, content=broken())) as robot,
        pytest.raises(UnavailableError, match="gone"),
    ):
        robot.fetch_backup(file)
    assert file.readlink() == theirs
    assert theirs.read_bytes() == b"theirs"
    assert not (tmp_path / "backup.zip.part").exists()


def test_an_array_of_points_is_sent_as_base64_and_a_list_as_it_is() -> None:
    points = np.array([[0.1, 0.2, 0.3], [1.0, -2.0, 3.5]])
    request = sent(lambda robot: robot.put_object("seen", "point_cloud", points=points, voxel=0.01, x=1.0))
    solid = json.loads(request.content)["objects"]["seen"]
    numbers = struct.unpack("<6f", base64.b64decode(solid.pop("points_base64")))
    assert numbers == pytest.approx(points.ravel())
    assert solid == {"shape": "point_cloud", "voxel": 0.01, "x": 1.0}
    request = sent(lambda robot: robot.change_scene(objects={"seen": {"points": [[1, 2, 3]]}, "old": None}))
    assert json.loads(request.content)["objects"] == {"seen": {"points": [[1, 2, 3]]}, "old": None}
    with (
        client(answering({})) as robot,
        pytest.raises(InputError, match=r"points: an array of shape \(n, 3\) is needed, got \(3,\)"),
    ):
        robot.put_object("seen", "point_cloud", points=points[0], voxel=0.01)
