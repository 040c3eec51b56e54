"""What generators of clients get.

Oracles: openapi-python-client and openapi-typescript with the compiler of TypeScript, where they are
installed; the models' own required fields.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from app.api.generators import suit_generators
from app.main import create_app
from cobot.config import Settings
from cobot.motions.bodies import MoveArc, MoveJoints, MoveNamed, MovePose

NODE_MODULES = Path(__file__).parents[3] / "node_modules"
PROGRAM = """
import createClient from "openapi-fetch";
import type { paths } from "./api.js";
const robot = createClient<paths>({ baseUrl: "http://localhost:8007/v1" });
const moved = await robot.POST("/robot/move/named", { body: { name: "home" } });
if (moved.data && "success" in moved.data) moved.data.code satisfies string | null | undefined;
await robot.POST("/robot/move/pose", { body: { x: 0.4, y: 0, z: 0.5, a: 0, b: 3.14, c: 0 } });
const joints = [0, 0.5, 0, -1.57, 0, 1.57, 0];
const plan = await robot.POST("/robot/plan/joints", { body: { joints } });
const path = { plan: plan.data?.plan_id ?? "" };
await robot.POST("/robot/plans/{plan}/execute", { params: { path } });
await robot.POST("/trajectory/send", { body: { points: [{ positions: joints, time_from_start: 2 }] } });
await robot.POST("/robot/control", { body: {} });
export {};
"""
COMPILER = {
    "compilerOptions": {
        "strict": True,
        "noEmit": True,
        "module": "nodenext",
        "target": "es2022",
        "skipLibCheck": True,
        "types": [],
    },
    "files": ["use.ts"],
}


@pytest.fixture(scope="module")
def document(settings: Settings) -> dict[str, Any]:
    return create_app(settings, None, "http://robot.test").openapi()


def test_nothing_has_the_name_that_a_framework_gives(document: dict[str, Any]) -> None:
    names = set(document["components"]["schemas"])
    assert names >= {"SendCsvForm", "StartSequenceForm"}
    assert not [name for name in names if not re.fullmatch("[A-Z][A-Za-z]+", name)]
    references = set(re.findall(r'"#/components/schemas/([^"]+)"', json.dumps(document)))
    assert references <= names


def test_the_document_says_what_it_is(document: dict[str, Any]) -> None:
    assert document["info"]["title"] == "cobot"
    assert document["info"]["license"] == {"name": "Apache-2.0", "identifier": "Apache-2.0"}
    assert document["security"] == [{}, {"token": []}]
    assert document["components"]["securitySchemes"]["token"]["scheme"] == "bearer"


@pytest.mark.parametrize("model", [MoveNamed, MoveJoints, MovePose, MoveArc])
def test_fields_of_requests_are_optional_and_say_their_default(
    document: dict[str, Any], model: type[BaseModel]
) -> None:
    schema = document["components"]["schemas"][model.__name__]
    required = {name for name, field in model.model_fields.items() if field.is_required()}
    assert set(schema["required"]) == required
    assert not [name for name, field in schema["properties"].items() if "default" in field]
    assert schema["properties"]["speed"]["description"].endswith("Default: 0.1.")


def test_fields_of_answers_keep_their_defaults(document: dict[str, Any]) -> None:
    assert document["components"]["schemas"]["MoveAnswer"]["properties"]["note"]["default"] == ""


def test_a_second_time_changes_nothing(document: dict[str, Any]) -> None:
    before = json.dumps(document)
    suit_generators(document)
    assert json.dumps(document) == before


def test_a_python_client_is_generated_and_can_be_imported(document: dict[str, Any], tmp_path: Path) -> None:
    pytest.importorskip("openapi_python_client")
    file, client = tmp_path / "api.json", tmp_path / "client"
    file.write_text(json.dumps(document))
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--meta", "none"]
    subprocess.run([*command, "--path", str(file), "--output-path", str(client)], check=True, timeout=300)
    use = "from client.models import MoveNamed; print(MoveNamed(name='home').to_dict())"
    done = subprocess.run(
        [sys.executable, "-c", use], cwd=tmp_path, check=True, capture_output=True, text=True, timeout=60
    )
    assert done.stdout.strip() == "{'name': 'home'}"


@pytest.mark.skipif(
    not (NODE_MODULES / "openapi-typescript").is_dir() or shutil.which("npx") is None,
    reason="npm install --no-save openapi-typescript openapi-fetch typescript",
)
def test_a_typescript_client_compiles_with_bodies_of_required_fields_alone(
    document: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "node_modules").symlink_to(NODE_MODULES)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "api.json").write_text(json.dumps(document))
    (tmp_path / "use.ts").write_text(PROGRAM)
    (tmp_path / "tsconfig.json").write_text(json.dumps(COMPILER))
    for command in (["openapi-typescript", "api.json", "-o", "api.d.ts"], ["tsc", "-p", "."]):
        done = subprocess.run(
            ["npx", "--no-install", *command],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
