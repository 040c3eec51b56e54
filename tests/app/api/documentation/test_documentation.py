"""The pages of Swagger and what they say. Oracle: the OpenAPI documents, walked; httpx, without a network.

How soon a browser shows them: benchmarks/web/pages.py.
"""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest
from asgi_client import ask
from fastapi import FastAPI
from virtual_service import VirtualService

from app.api.documentation.links import link
from app.api.documentation.samples import SAMPLES, SAMPLES_PATH
from app.aubo.classes import CLASSES, REGISTRY
from app.main import create_app
from app.routes import ENDPOINTS
from cobot.config import Settings

DOCUMENTS = {
    "/docs": "/openapi/robot.json",
    "/docs/robots": "/openapi/robots.json",
    "/docs/vendor": "/openapi/vendor.json",
    "/redoc": "/openapi.json",
}
BY_NAME = "/robots/{robot}"


@pytest.fixture(scope="module")
def app(settings: Settings) -> FastAPI:
    return create_app(settings, None, "http://robot.test")


def operations(document: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield f"{method.upper()} {path}", operation


def resolved(document: dict[str, Any], part: dict[str, Any]) -> dict[str, Any]:
    """A part of a document, or what it refers to."""
    if "$ref" not in part:
        return part
    for name in part["$ref"].split("/")[1:]:
        document = document[name]
    return document


def undescribed(place: str, schema: dict[str, Any], models: dict[str, Any], seen: set[str]) -> Iterator[str]:
    """The properties below a schema that say nothing about themselves."""
    name = schema.get("$ref", "").rpartition("/")[2]
    if name:
        if name not in seen:
            yield from undescribed(name, models[name], models, seen | {name})
        return
    for key in ("anyOf", "allOf", "oneOf", "prefixItems"):
        for index, each in enumerate(schema.get(key, [])):
            yield from undescribed(f"{place} {key}[{index}]", each, models, seen)
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            yield from undescribed(f"{place}[]", schema[key], models, seen)
    for field, each in schema.get("properties", {}).items():
        if not each.get("description"):
            yield f"{place}.{field}"
        yield from undescribed(f"{place}.{field}", each, models, seen)


@pytest.mark.parametrize("path", DOCUMENTS.values())
def test_every_operation_parameter_and_field_is_described(app: FastAPI, path: str) -> None:
    document = ask(app, "GET", path).json()
    models = document["components"]["schemas"]
    missing = []
    for name, operation in operations(document):
        missing += [name for key in ("summary", "description") if not operation.get(key)]
        for each in operation.get("parameters", []):
            parameter = resolved(document, each)
            if not parameter.get("description"):
                missing.append(f"{name}: {parameter['name']}")
        answers = [resolved(document, each) for each in operation["responses"].values()]
        bodies = [operation.get("requestBody", {}), *answers]
        for content in (each for body in bodies for each in body.get("content", {}).values()):
            missing += undescribed(name, content["schema"], models, set())
    assert sorted(set(missing)) == []


@pytest.mark.parametrize("page", DOCUMENTS)
def test_each_page_shows_its_own_document(app: FastAPI, page: str) -> None:
    assert re.search(rf"""(?:url: |spec-url=)['"]{DOCUMENTS[page]}['"]""", ask(app, "GET", page).text)


def test_the_page_of_the_rest_api_has_each_operation_once_and_its_first_group_open(app: FastAPI) -> None:
    document = ask(app, "GET", DOCUMENTS["/docs"]).json()
    served = {name for name in ENDPOINTS if "{Class}" not in name and not name.startswith("WS ")}
    assert {name for name, _ in operations(document)} == served
    text = ask(app, "GET", "/docs").text
    assert '"docExpansion": "none"' in text
    assert '["operations-tag", "robot"], true' in text
    assert document["tags"][0]["name"] == "robot"
    groups = [operation["tags"] for _, operation in operations(document)]
    assert {tag for tags in groups for tag in tags} == {tag["name"] for tag in document["tags"]}
    assert groups.count(["robot"]) < 25, "what is open at first is what most people come for"
    for page in ("(/docs/vendor)", "(/docs/robots)"):
        assert page in document["info"]["description"]


def test_the_page_of_any_robot_has_the_same_with_its_name_in_the_same_groups(app: FastAPI) -> None:
    plain, named, whole = (
        ask(app, "GET", DOCUMENTS[page]).json() for page in ("/docs", "/docs/robots", "/redoc")
    )
    groups = {operation["operationId"]: operation["tags"] for _, operation in operations(plain)}
    found = dict(operations(named))
    assert len(found) > 50
    for name, operation in found.items():
        assert f" {BY_NAME}/" in name
        assert operation["tags"] == groups[operation["operationId"].removesuffix("_of")], name
    assert set(dict(operations(whole))) == set(found) | set(dict(operations(plain)))
    assert all(operation["tags"] == ["robots"] for name, operation in operations(whole) if name in found)


def test_the_page_of_the_vendor_services_has_those_alone(app: FastAPI) -> None:
    document = ask(app, "GET", DOCUMENTS["/docs/vendor"]).json()
    found = {tuple(path.split("/")[2:]) for path in document["paths"]}
    assert found == set(REGISTRY)
    assert [tag["name"] for tag in document["tags"]] == list(CLASSES)
    assert all(operation["tags"][0] in CLASSES for _, operation in operations(document))
    page = ask(app, "GET", "/docs/vendor").text
    assert page.index('<a href="/docs">') < page.index("swagger-ui-bundle.js"), "first painted, then run"
    assert '"docExpansion": "none"' in page


@pytest.mark.parametrize("path", DOCUMENTS.values())
def test_no_document_refers_to_what_it_does_not_have(app: FastAPI, path: str) -> None:
    text = ask(app, "GET", path).text
    components = json.loads(text)["components"]
    for kind, name in re.findall(r'"#/components/(\w+)/([^"]+)"', text):
        assert name in components[kind]


def test_a_wrong_method_is_told_all_that_the_path_has(app: FastAPI) -> None:
    for path, methods in ask(app, "GET", "/openapi.json").json()["paths"].items():
        wrong = ask(app, "PATCH", re.sub(r"{\w+}", "iiwa", path))
        allowed = ", ".join(sorted(method.upper() for method in methods))
        assert (wrong.status_code, wrong.headers["allow"]) == (405, allowed), path
        assert wrong.json()["detail"].endswith(f"; allowed: {allowed}")


def fields(document: dict[str, Any], body: dict[str, Any]) -> set[str]:
    """Of the JSON of an answer, or of a request."""
    return set(resolved(document, body["content"]["application/json"]["schema"])["properties"])


def links(document: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Each link of a document: the operation that has it, the answer, and the link itself."""
    for name, operation in operations(document):
        for answer in operation["responses"].values():
            yield from ((name, answer, each) for each in answer.get("links", {}).values())


@pytest.mark.parametrize("path", ["/openapi.json", "/openapi/robot.json", "/openapi/robots.json"])
def test_links_lead_from_fields_of_answers_to_what_operations_of_the_document_take(
    app: FastAPI, path: str
) -> None:
    document = ask(app, "GET", path).json()
    named = {operation["operationId"]: operation for _, operation in operations(document)}
    found = set()
    for source, answer, each in links(document):
        target, parameters = named[each["operationId"]], each.get("parameters", {})
        taken = {it["name"]: it["in"] for it in target.get("parameters", [])}
        assert {name for name, place in taken.items() if place == "path"} <= set(parameters) <= set(taken)
        if BY_NAME in source:
            assert parameters.pop("robot") == "$request.path.robot"
        body = each.get("requestBody", {})
        assert not body or set(body) <= fields(document, target["requestBody"])
        for value in [*parameters.values(), *body.values()]:
            assert value.removeprefix("$response.body#/").partition("/")[0] in fields(document, answer)
        found.add((source.replace(BY_NAME, "").split("/")[-1], each["operationId"].removesuffix("_of")))
    assert {("sequence", "execute"), ("joints", "cancel_job"), ("control", "release_control")} <= found
    assert not any(source.startswith("DELETE") for source, *_ in links(document)), "what it names is gone"


def test_nothing_links_to_what_is_switched_off() -> None:
    answer = {"content": {"application/json": {"schema": {"$ref": "#/components/schemas/PlanAnswer"}}}}
    plan = {"operationId": "plan_pose", "responses": {"200": answer}}
    rehearse = {"operationId": "rehearse", "responses": {}}
    document = {"paths": {"/plan": {"post": plan}, "/rehearse": {"post": rehearse}}}
    link(document)
    assert [each["operationId"] for *_, each in links(document)] == ["rehearse"]


def test_every_upload_says_where_a_sample_is(app: FastAPI) -> None:
    document = ask(app, "GET", "/openapi.json").json()
    models = document["components"]["schemas"]
    found = set()
    for name, operation in operations(document):
        content = operation.get("requestBody", {}).get("content", {}).get("multipart/form-data")
        if content is None or name.endswith("/admin/restore"):  # whose sample is GET /admin/backup
            continue
        fields = models[content["schema"]["$ref"].rpartition("/")[2]]["properties"]
        links = re.findall(rf"\({SAMPLES_PATH}/([^)]+)\)", json.dumps(fields))
        assert links, name
        found |= set(links)
    assert found == set(SAMPLES)


def test_a_sample_that_is_not_there_is_not_found_and_those_that_are_are_listed(app: FastAPI) -> None:
    answer = ask(app, "GET", f"{SAMPLES_PATH}/trajectori.csv")
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
    assert "did you mean 'trajectory.csv'" in answer.json()["detail"]


def test_a_document_is_made_once_and_anew_when_a_reload_has_changed_the_limits(
    service: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = 0
    openapi = service.app.openapi

    def counted() -> dict[str, Any]:
        nonlocal made
        made += 1
        return openapi()

    def greatest() -> float:
        models = service.get("/openapi.json").json()["components"]["schemas"]
        return float(models["MoveJoints"]["properties"]["joints"]["prefixItems"][6]["maximum"])

    monkeypatch.setattr(service.app, "openapi", counted)
    limits = service.app.state.services.robot.limits
    before = replace(limits)
    high = limits.max_position.copy()
    high[6] = 1.0
    assert [greatest(), greatest()] == [before.max_position[6]] * 2
    limits.take_over(replace(before, max_position=high))
    assert [greatest(), greatest()] == [1.0, 1.0]
    limits.take_over(before)
    assert greatest() == before.max_position[6]
    assert made == 3

    async def together() -> list[httpx.Response]:
        asked = [service.asking("GET", path) for path in DOCUMENTS.values() for _ in range(3)]
        return await asyncio.gather(*asked)

    assert len({answer.content for answer in service.run(together())}) == len(DOCUMENTS)
    assert made == 2 + len(DOCUMENTS), "those of the pages are made of the whole one"


def test_the_sample_trajectory_runs_from_anywhere(service: VirtualService) -> None:
    service.post("/robot/move/joints", {"joints": [0.4, 0.1, 0.0, -1.4, 0.0, 1.5, 0.0], "speed": 1.0})
    sample = service.get(f"{SAMPLES_PATH}/trajectory.csv")
    assert sample.headers["content-type"].startswith("text/csv")
    files = {"file": ("trajectory.csv", sample.content)}
    sent = service.ask("POST", "/trajectory/send_csv?move_to_start=true", files=files)
    assert sent.json()["points"] == 3, sent.text
    service.until(lambda: service.get("/robot/control").json()["what"] is None)
    assert service.joints() == pytest.approx([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0], abs=1e-3)


@pytest.mark.parametrize("name", ["sequence.json", "program.lua"])
def test_the_other_samples_are_what_the_runner_takes(name: str, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_text(SAMPLES[name][1], encoding="utf-8")
    command = [sys.executable, "-P", "-m", "cobot.runner", "check", str(file)]
    checked = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert checked.returncode == 0, checked.stderr
