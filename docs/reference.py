"""The pages of the site that are made of the code: REST of its OpenAPI document, Python of its docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping
from typing import Any

LINK = re.compile(r"\[([^\]]+)\]\([^)]*\)")
BELOW = "/robots/{robot}/"


def pages() -> dict[str, str]:
    """Their text, by the name of the file."""
    return {
        "reference-rest.md": "\n".join(_rest()) + "\n",
        "reference-python.md": "\n".join(_python()) + "\n",
    }


def _rest() -> Iterator[str]:
    from app.main import create_app
    from cobot.config import load_settings

    document = create_app(load_settings(), None, "http://localhost:8007").openapi()
    schemas = document["components"]["schemas"]
    yield "# REST, endpoint by endpoint\n"
    yield (
        "Made of the service's own OpenAPI document, which a running service has at `/docs` to try and at "
        "`/openapi.json` for programs. What it means, with examples: [api.md](api.md). Each endpoint of a "
        "robot is there below `/robots/NAME` too."
    )
    operations = [
        (path, method, operation)
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
        if not path.startswith((BELOW, "/{robot}/"))
    ]
    for tag in (each["name"] for each in document["tags"]):
        own = [each for each in operations if tag in each[2].get("tags", ())]
        if own:
            yield f"\n## {tag.capitalize()}"
        for path, method, operation in own:
            yield f"\n### {method.upper()} {path}\n"
            yield _plain(operation.get("description", "")) + "\n"
            yield from _parameters(operation)
            yield from _body(operation, schemas)
            yield from _answers(operation)


def _parameters(operation: Mapping[str, Any]) -> Iterator[str]:
    parameters = operation.get("parameters", [])
    if parameters:
        yield "| Parameter | In | |\n|---|---|---|"
    for each in parameters:
        needed = "" if each.get("required") else " (optional)"
        about = _cell(each.get("description", each["schema"].get("description", "")))
        yield f"| `{each['name']}` | {each['in']}{needed} | {about} |"
    if parameters:
        yield ""


def _body(operation: Mapping[str, Any], schemas: Mapping[str, Any]) -> Iterator[str]:
    for kind, content in operation.get("requestBody", {}).get("content", {}).items():
        name = content["schema"].get("$ref", "").rpartition("/")[2]
        model = schemas.get(name, {})
        yield f"Body: `{kind}`\n\n| Field | Type | |\n|---|---|---|"
        for field, about in model.get("properties", {}).items():
            default = f" Default: `{about['default']}`." if "default" in about else ""
            needed = " **Needed.**" if field in model.get("required", ()) else ""
            yield f"| `{field}` | {_type(about)} | {_cell(about.get('description', ''))}{default}{needed} |"
        yield ""


def _answers(operation: Mapping[str, Any]) -> Iterator[str]:
    for status, answer in operation["responses"].items():
        yield f"- {status}: {_plain(answer.get('description', ''))}"


def _type(schema: Mapping[str, Any]) -> str:
    """In a word or two."""
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    if "enum" in schema:
        return ", ".join(f"`{each}`" for each in schema["enum"])
    for several in ("anyOf", "oneOf"):
        if several in schema:
            return " or ".join(dict.fromkeys(_type(each) for each in schema[several]))
    if schema.get("type") == "array":
        return f"list of {_type(schema.get('items', {}))}"
    return str(schema.get("type", "anything"))


def _python() -> Iterator[str]:
    from cobot import client

    yield "# Python, class by class\n"
    yield "Made of the docstrings of `cobot.client`; begin with [the tutorial](tutorial-python.md)."
    for name in sorted(client.__all__):
        made = getattr(client, name)
        if not inspect.isclass(made):
            continue
        yield f"\n## {name}\n"
        yield from _text(inspect.getdoc(made) or "")
        for method, function in inspect.getmembers(made, inspect.isfunction):
            if not method.startswith("_") and function.__doc__:
                yield f"\n### {name}.{method}\n"
                yield f"```python\ndef {method}{_signature(function)}: ...\n```\n"
                yield from _text(inspect.getdoc(function) or "")


def _signature(function: Any) -> str:
    """With its annotations as they are written."""
    parts = [str(each).replace("'", "") for each in inspect.signature(function).parameters.values()]
    return f"({', '.join(parts)})"


def _text(documentation: str) -> Iterator[str]:
    yield "```text"
    yield documentation
    yield "```"


def _plain(text: str) -> str:
    """Without links, which lead elsewhere from a site."""
    return LINK.sub(r"\1", text).strip()


def _cell(text: str) -> str:
    return _plain(text).replace("\n", " ").replace("|", "\\|")
