"""What endpoints declare of the control holds: each is asked while another client has it.

Oracle: docs/conventions.md#control, written out by hand; the requests are the examples of the schema.
"""

from __future__ import annotations

from typing import Any

import httpx
import pytest
from virtual_service import VirtualService

from app.api.endpoints import Endpoint
from app.api.route import CobotRoute, EndpointRouter
from app.routes import ENDPOINTS
from app.services.motion.execution import REST_TIMEOUT_S
from app.services.state.commands import STATE_S
from cobot.access.roles import Role
from cobot.client.connection import LONG_TIMEOUTS_S, MOTION_TIMEOUT_S
from rtloop.backends.threaded_enabling import ENABLE_S

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
AWAY = [0.5, *HOME[1:]]
WITHOUT_CONTROL = {
    "DELETE /access/tokens/{name}",
    "POST /access/tokens",
    "POST /stop",
    "POST /robot/gripper/stop",
    "POST /jobs/{job}/cancel",
    "POST /jobs/{job}/pause",
    "POST /robot/reset",
    "DELETE /robot/freedrive",
    "POST /robot/approve",
    "POST /robot/plans/{plan}/approve",
    "POST /robot/plans/{plan}/improve",
    "POST /robot/plans/{plan}/rehearse",
    "POST /recordings",
    "DELETE /recordings/{name}",
    "POST /robot/tool/calibrate",
    "POST /admin/restore",
    "PUT /programs/{program}",
    "DELETE /programs/{program}",
    "POST /studies",
    "DELETE /studies/{study}",
    *(
        f"POST /robot/plan/{kind}"
        for kind in ("named", "joints", "pose", "arc", "path", "sequence", "gripper")
    ),
}
"""They stop, wait, plan, record, or manage files and access."""
OF_THE_CONTROL = {"POST /robot/control", "DELETE /robot/control"}
VENDOR = "POST /{robot}/{Class}/{method}"
"""Each method of the vendor's has its own rule: tests/app/api/routers/test_control.py."""
FILES = {
    "POST /trajectory/send_csv": {"files": {"file": ("a.csv", b"t")}},
    "POST /sequences/start": {"files": {"config": ("a.json", b"{}")}},
    "POST /admin/restore": {"files": {"file": ("a.zip", b"{}")}},
}


def taken(run: VirtualService, robot: str) -> dict[str, str]:
    """Take the control of a robot; the header that shows it."""
    answer = run.post(f"/robots/{robot}/control", {"timeout_s": 3600.0})
    assert answer.status_code == 200, answer.text
    return {"X-Control-Token": answer.json()["token"]}


def example(run: VirtualService, name: str) -> dict[str, Any]:
    """The body of a request, for httpx."""
    method, path = name.split(" ")
    if name in FILES:
        return FILES[name]
    schema = run.app.openapi()
    body = schema["paths"][path][method.lower()].get("requestBody")
    if body is None:
        return {}
    model = body["content"]["application/json"]["schema"]["$ref"].rpartition("/")[2]
    return {"json": schema["components"]["schemas"][model]["examples"][0]}


def is_kept_out(answer: httpx.Response) -> bool:
    """Whether the reason is the control of another client."""
    return answer.status_code == 409 and "has control of the robot" in answer.json()["detail"]


def test_each_endpoint_that_changes_something_heeds_the_control_or_is_listed(pair: VirtualService) -> None:
    changing = {name for name in ENDPOINTS if name.split()[0] not in ("GET", "WS")}
    robot = pair.name
    points = {"points": [{"positions": AWAY, "time_from_start": 60.0}]}
    pair.post("/trajectory/send", points).raise_for_status()
    (job,) = (each["id"] for each in pair.get("/jobs?state=running").json()["jobs"])
    plan = pair.post("/robot/plan/joints", {"joints": AWAY, "start": HOME}).json()["plan_id"]
    pair.post("/stop").raise_for_status()
    holder = taken(pair, robot)
    found = {}
    for name in sorted(changing - OF_THE_CONTROL - {VENDOR}):
        method, path = name.split(" ")
        filled = path.replace("{job}", job).replace("{plan}", plan).replace("{name}", "home")
        content = {"json": {"plan_id": plan}} if name == "POST /robot/approve" else example(pair, name)
        answer = pair.ask(method, filled, **content)
        assert answer.status_code != 422 or name in WITHOUT_CONTROL, (name, answer.text)
        found[name] = is_kept_out(answer)
    pair.ask("DELETE", "/robot/control", headers=holder).raise_for_status()
    assert {name for name, kept_out in found.items() if not kept_out} == WITHOUT_CONTROL
    assert {name for name, kept_out in found.items() if kept_out} == {
        name for name, endpoint in ENDPOINTS.items() if endpoint.control
    }


@pytest.mark.parametrize("below", ["", "/robots/{robot}"])
def test_a_job_is_under_the_control_of_its_own_robot(pair: VirtualService, below: str) -> None:
    """Its address need not name the robot; then a lease of the default robot kept it paused."""
    first, second = pair.names
    points = {"points": [{"positions": AWAY, "time_from_start": 60.0}]}
    pair.post(f"/robots/{second}/trajectory/send", points).raise_for_status()
    (job,) = (each["id"] for each in pair.get(f"/robots/{second}/jobs?state=running").json()["jobs"])
    way = f"{below.format(robot=second)}/jobs/{job}"
    of_first = taken(pair, first)
    assert pair.post(f"{way}/pause").json()["state"] == "paused"
    assert pair.post(f"{way}/resume").json()["state"] == "running"
    assert pair.post(f"{way}/pause").json()["state"] == "paused"
    pair.ask("DELETE", "/robot/control", headers=of_first).raise_for_status()
    of_second = {"X-Control-Token": pair.post(f"/robots/{second}/control", {"force": True}).json()["token"]}
    assert is_kept_out(pair.post(f"{way}/resume"))
    pair.ask("DELETE", f"/robots/{second}/control", headers=of_second).raise_for_status()


def test_an_unknown_job_is_not_found_whatever_is_asked_of_it(pair: VirtualService) -> None:
    for path in ("/jobs/none", f"/robots/{pair.names[1]}/jobs/none"):
        answers = [pair.get(path), *(pair.post(f"{path}/{what}") for what in ("cancel", "pause", "resume"))]
        for answer in answers:
            assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
            assert "there is no job 'none'" in answer.json()["detail"]


def test_each_endpoint_with_a_body_checks_its_media_type_and_documents_what_it_refuses(
    pair: VirtualService,
) -> None:
    """Oracle: which endpoints have a body by FastAPI's reading of them."""
    routes = [each for each in pair.app.routes if isinstance(each, CobotRoute) and each.dependant.body_params]
    assert len(routes) >= 40
    job = pair.post("/robot/move/named?wait=false", {"name": "home"}).json()["id"]
    for route in routes:
        assert {413, 415, 422} <= route.responses.keys(), route.path
        (method,) = route.methods
        path = route.path.replace("{robot}", pair.name).replace("{job}", job)
        answer = pair.ask(method, path, content=b"{}", headers={"content-type": "text/plain"})
        assert (answer.status_code, answer.json()["code"]) == (415, "media_type"), path


@pytest.mark.parametrize("path", ["/robot/freedrive", "/robot/speed_override", "/jobs/{job}/pause"])
def test_what_a_backend_may_be_unable_to_do_has_a_501_in_the_schema(pair: VirtualService, path: str) -> None:
    """Oracle: where `NotSupportedError` is raised: freedrive, `SpeedOverride._require_path_clock`."""
    assert "501" in pair.app.openapi()["paths"][path]["post"]["responses"]


@pytest.mark.parametrize(
    ("name", "options", "reason"),
    [
        ("GET /state", {"control": True}, "control is for requests that change something"),
        ("WS /state", {"control": True}, "control is for requests that change something"),
        ("POST /state", {"costly": True}, "costly is for GET"),
        ("WS /state", {"costly": True}, "costly is for GET"),
    ],
)
def test_a_declaration_that_would_be_ignored_is_an_error(
    name: str, options: dict[str, bool], reason: str
) -> None:
    with pytest.raises(ValueError, match=f"{name}: {reason}"):
        Endpoint(name, Role.OBSERVER, 1.5, **options)

    async def serve() -> None: ...

    with pytest.raises(ValueError, match=reason):
        EndpointRouter().endpoint(name, Role.OBSERVER, 1.5, **options)(serve)


def test_the_client_waits_longer_than_the_service_takes() -> None:
    for endpoint in ENDPOINTS.values():
        method, path = endpoint.name.split(" ")
        if method == "POST" and (endpoint.control or path in LONG_TIMEOUTS_S):
            wait_s = max(MOTION_TIMEOUT_S, LONG_TIMEOUTS_S.get(path, 0.0))
            assert wait_s > endpoint.timeout_s + REST_TIMEOUT_S, endpoint.name


def test_a_reset_waits_longer_than_a_device_may_take_to_be_enabled() -> None:
    """Otherwise the client does not read that the device does not answer."""
    assert ENDPOINTS["POST /robot/reset"].timeout_s > STATE_S + ENABLE_S
