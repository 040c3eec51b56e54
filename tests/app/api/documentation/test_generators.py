"""What generators of clients get.

Oracles: openapi-python-client, and the models' own required fields. The compiler of TypeScript is the oracle
of tests/e2e/test_js_client.py.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from app.api.documentation.generators import suit_generators
from app.main import create_app
from cobot.config import Settings
from cobot.motions.bodies import MoveArc, MoveJoints, MoveNamed, MovePose


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


def test_a_value_that_may_be_null_is_no_union_of_types(document: dict[str, Any]) -> None:
    answer = document["components"]["schemas"]["MoveAnswer"]["properties"]
    assert answer["motion_id"]["type"] == ["integer", "null"]
    assert "enum" in answer["code"]["oneOf"][0]


def test_a_second_time_changes_nothing(document: dict[str, Any]) -> None:
    before = json.dumps(document)
    suit_generators(document)
    assert json.dumps(document) == before


@pytest.mark.thorough
def test_a_python_client_is_generated_and_can_be_imported(document: dict[str, Any], tmp_path: Path) -> None:
    file, client = tmp_path / "api.json", tmp_path / "client"
    file.write_text(json.dumps(document))
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--meta", "none"]
    subprocess.run([*command, "--path", str(file), "--output-path", str(client)], check=True, timeout=300)
    use = "from client.models import MoveNamed; print(MoveNamed(name='home').to_dict())"
    done = subprocess.run(
        [sys.executable, "-c", use], cwd=tmp_path, check=True, capture_output=True, text=True, timeout=60
    )
    assert done.stdout.strip() == "{'name': 'home'}"
