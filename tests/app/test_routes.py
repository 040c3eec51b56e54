"""Which endpoints there are, their names, and those that are switched off.

Oracle: what the endpoints declare; httpx as the client, without a network.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from asgi_client import ask
from fastapi import FastAPI

from app.main import create_app
from app.routes import ENDPOINTS
from cobot.config import Settings

OF_THE_SERVICE = {"/audit", "/metrics", "/health/live", "/access/tokens", "/access/tokens/{name}"} | {
    f"/admin/{each}" for each in ("reload", "backup", "restore", "support")
}


@pytest.fixture(scope="module")
def schema(settings: Settings) -> dict[str, Any]:
    return create_app(settings, None, "http://robot.test").openapi()


def without(settings: Settings, folder: Path, *endpoints: str) -> FastAPI:
    content = {"endpoints": {name: {"enabled": False} for name in endpoints}}
    file = folder / "endpoints.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    web = settings.web.model_copy(update={"endpoints": file})
    return create_app(settings.model_copy(update={"web": web}), None, "http://robot.test")


def test_the_schema_has_exactly_the_declared_endpoints(schema: dict[str, Any]) -> None:
    found = {f"{method.upper()} {path}" for path, methods in schema["paths"].items() for method in methods}
    plain = {name for name in found if "{robot}" not in name}
    # OpenAPI knows no WebSockets, and each vendor service has a path of its own
    assert plain == {name for name in ENDPOINTS if not name.startswith("WS ") and "{robot}" not in name}


def test_every_endpoint_about_a_robot_is_there_for_a_robot_by_name(schema: dict[str, Any]) -> None:
    paths = set(schema["paths"])
    assert paths >= OF_THE_SERVICE
    plain = [path for path in paths - OF_THE_SERVICE if "{robot}" not in path and path != "/robots"]
    named = {path for path in schema["paths"] if path.startswith("/robots/{robot}/")}
    assert named == {
        f"/robots/{{robot}}{re.sub('^/robot/', '/', path)}" for path in plain if "{robot}" not in path
    }
    for path in named:
        for operation in schema["paths"][path].values():
            by_name = {each["name"]: each for each in operation["parameters"] if each["in"] == "path"}
            assert by_name["robot"]["schema"]["enum"] == ["iiwa"]
            assert "404" in operation["responses"]


def test_operations_are_named_after_what_they_do(schema: dict[str, Any]) -> None:
    operations = [operation for methods in schema["paths"].values() for operation in methods.values()]
    names = [operation["operationId"] for operation in operations]
    assert len(set(names)) == len(names)
    assert {"joint_states", "move_joints", "stop"} <= set(names)
    assert len({operation["summary"] for operation in operations}) == len(operations)


def test_summaries_are_whole_sentences(schema: dict[str, Any]) -> None:
    """A description may be wrapped in the middle of its first sentence. Oracle: the description."""
    found = [each for operations in schema["paths"].values() for each in operations.values()]
    assert len(found) > 200
    for each in found:
        summary = each["summary"].removesuffix(" For any robot.")
        described = " ".join(each["description"].split()) + " "
        assert described.startswith(summary.removesuffix(".")), summary
        assert described[len(summary) - 1] == "." or described.strip() == summary.removesuffix("."), summary


def test_an_endpoint_that_is_switched_off_is_not_there(settings: Settings, tmp_path: Path) -> None:
    app = without(settings, tmp_path, "POST /robot/move/pose", "GET /trajectory/logs")
    assert "/robot/move/pose" not in app.openapi()["paths"]
    assert "/robot/move/joints" in app.openapi()["paths"]
    assert "/robots/{robot}/move/pose" not in app.openapi()["paths"]
    for path in ("/robot/move/pose", "/robots/iiwa/move/pose"):
        answer = ask(app, "POST", path)
        assert (answer.status_code, answer.json()["code"]) == (404, "not_found")


def test_a_schema_of_nothing_but_the_stop_is_a_schema(settings: Settings, tmp_path: Path) -> None:
    others = ENDPOINTS.keys() - {"POST /stop"}
    paths = list(without(settings, tmp_path, *others).openapi()["paths"])
    assert paths == ["/stop", "/robots/{robot}/stop"]
