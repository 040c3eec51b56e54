"""The arguments of tools. Each tool has one model, which is published as its schema and validates calls.

The MCP library's own model of a tool ignores unknown arguments and accepts strings as numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, get_type_hints

from pydantic import BaseModel, ValidationError, create_model

from cobot.errors import InputError
from cobot.strict import StrictModel, sentences

CONTEXT = "ctx"
"""Name of the parameter that passes the library's context to tools."""


Tool = Callable[..., Any]


def takes_fields_of(body: type[BaseModel], *names: str) -> Callable[[Tool], Tool]:
    """Replace a tool's `**fields` with fields of a REST body, including their ranges, descriptions and
    defaults.
    """

    def sign(tool: Tool) -> Tool:
        hints = get_type_hints(tool, include_extras=True)
        own = [each for each in signature(tool).parameters.values() if each.kind is not Parameter.VAR_KEYWORD]
        taken = []
        for name in names:
            field = body.model_fields[name]
            hints[name] = Annotated[field.annotation, field]
            default = Parameter.empty if field.is_required() else field.get_default(call_default_factory=True)
            taken.append(Parameter(name, Parameter.KEYWORD_ONLY, default=default))
        parameters = [
            each.replace(kind=Parameter.KEYWORD_ONLY, annotation=hints[each.name]) for each in own + taken
        ]
        tool.__annotations__ = {each.name: each.annotation for each in parameters}
        tool.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        return tool

    return sign


def arguments_of(tool: Callable[..., Any]) -> type[StrictModel]:
    """Return the model of a tool's arguments, derived from its signature."""
    hints = get_type_hints(tool, include_extras=True)
    fields: dict[str, Any] = {
        name: (hints[name], ... if parameter.default is Parameter.empty else parameter.default)
        for name, parameter in signature(tool).parameters.items()
        if name != CONTEXT
    }
    return create_model(tool.__name__, __base__=StrictModel, **fields)


def require_valid(model: type[StrictModel], name: str, arguments: dict[str, Any]) -> None:
    """Check the arguments of a tool.

    Raises:
        InputError: an argument is invalid. The error has the tool, the argument, its value and the valid
            values.
    """
    try:
        model.model_validate(arguments)
    except ValidationError as exc:
        raise InputError(f"{name}: {sentences(exc.errors(include_url=False))}") from exc
