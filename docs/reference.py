"""The pages of the site that are made of the code: REST of its OpenAPI document, Python of its docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Iterator, Mapping
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
        "`/openapi.json` for programs. [HTTP API](api.md) leads to the pages that explain it, with examples. "
        "Each endpoint of a robot is also available under `/robots/NAME`. Types with a name are listed last."
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
            yield from _answers(operation, schemas)
    yield from _models((each[2] for each in operations), schemas)


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
        yield f"Body: `{kind}`\n"
        yield from _fields(_resolved(content["schema"], schemas), " **Required.**")


def _answers(operation: Mapping[str, Any], schemas: Mapping[str, Any]) -> Iterator[str]:
    content = operation["responses"].get("200", {}).get("content", {}).get("application/json")
    if content:
        schema = content["schema"]
        several = schema.get("type") == "array"
        yield f"Response{', a list of' if several else ''}:\n"
        yield from _fields(_resolved(schema["items"] if several else schema, schemas))
    for status, answer in operation["responses"].items():
        yield f"- {status}: {_plain(answer.get('description', ''))}"


def _resolved(schema: Mapping[str, Any], schemas: Mapping[str, Any]) -> Mapping[str, Any]:
    return schemas.get(_name(schema), schema)


def _name(schema: Mapping[str, Any]) -> str:
    """The name of the model that a schema refers to, or ""."""
    return str(schema.get("$ref", "")).rpartition("/")[2]


def _fields(model: Mapping[str, Any], required: str = "") -> Iterator[str]:
    """The fields of a body or of a response, as a table."""
    if not model.get("properties"):
        yield f"{_type(model)}\n"
        return
    yield "| Field | Type | |\n|---|---|---|"
    for field, about in model["properties"].items():
        default = f" Default: `{about['default']}`." if about.get("default", "") != "" else ""
        needed = required if field in model.get("required", ()) else ""
        text = f"{_cell(about.get('description', ''))}{_range(about)}{default}{needed}"
        yield f"| `{field}` | {_type(about)} | {text} |"
    yield ""


def _models(operations: Iterable[Mapping[str, Any]], schemas: Mapping[str, Any]) -> Iterator[str]:
    """The models that fields refer to, once each."""
    shown: set[str] = set()
    wanted: list[str] = []
    for operation in operations:
        for part in (operation.get("requestBody", {}), operation["responses"].get("200", {})):
            for content in part.get("content", {}).values():
                shown.add(_name(content["schema"].get("items", content["schema"])))
                wanted += _referred(_resolved(content["schema"].get("items", content["schema"]), schemas))
    yield "\n## Models"
    while wanted:
        name = wanted.pop(0)
        if name not in shown:
            shown.add(name)
            wanted += _referred(schemas[name])
            yield f"\n### {name}\n"
            yield _plain(schemas[name].get("description", "")) + "\n"
            yield from _fields(schemas[name], " **Required.**")


def _referred(schema: Any) -> list[str]:
    """The names of the models that a schema refers to, at any depth."""
    if isinstance(schema, Mapping):
        own = [_name(schema)] if "$ref" in schema else []
        return own + [name for each in schema.values() for name in _referred(each)]
    return [name for each in schema for name in _referred(each)] if isinstance(schema, list) else []


def _range(schema: Mapping[str, Any]) -> str:
    """The limits of a value, of a text or of a list, for people."""
    schema = next((each for each in schema.get("anyOf", ()) if each.get("type") != "null"), schema)
    for name, unit in (("imum", ""), ("Length", " characters"), ("Items", " items")):
        low, high = schema.get(f"min{name}"), schema.get(f"max{name}")
        if low is not None and high is not None:
            return f" {low:g} to {high:g}{unit}."
        if low is not None or high is not None:
            return f" At least {low:g}{unit}." if high is None else f" At most {high:g}{unit}."
    return ""


def _type(schema: Mapping[str, Any]) -> str:
    """In a word or two."""
    if "$ref" in schema:
        return _name(schema)
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
