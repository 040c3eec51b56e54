"""Reads JSON as MATLAB and R write it: a bare item instead of a list with one item, and `[]` instead of an
absent value.

Both encoders drop the brackets of a list with one item, and can express an absent value only as an empty
list. `RequestModel` accepts both forms in each field, depending on the field's type.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, ForwardRef, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, model_validator

from cobot.strict import StrictModel, keys_of

ABSENT: Any = object()
"""Marks a field that the document does not give, so that the field gets its default."""


@dataclass(frozen=True, slots=True)
class JsonShape:
    """The JSON values that a type accepts.

    Attributes:
        kinds: Python types of the values.
        item: shape of a list's items.
        entry: shape of a mapping's values.
        filled: whether a list of this type must contain at least one item.
    """

    kinds: frozenset[type]
    item: JsonShape | None = None
    entry: JsonShape | None = None
    filled: bool = False

    def read(self, value: Any) -> Any:
        """Convert a value to the form that the type expects. A value that cannot be converted is not changed,
        and the type rejects it.
        """
        if isinstance(value, list) and not value:
            return self._nothing()
        if self.item is not None and not self._is_accepted(value):
            item = self.item.read(value)
            return [item] if self.item.accepts(item) else value
        if self.entry is not None and isinstance(value, dict):
            return {name: self.entry.read_kept(each) for name, each in value.items()}
        return value

    def read_kept(self, value: Any) -> Any:
        """Like `read`, but never returns ABSENT: an entry of a mapping has no default."""
        found = self.read(value)
        return value if found is ABSENT else found

    def accepts(self, value: Any) -> bool:
        return type(value) in self.kinds

    def _is_accepted(self, value: Any) -> bool:
        """Whether a value needs no additional brackets. For example, a row of numbers is not a list of
        rows.
        """
        if not self.accepts(value):
            return False
        rows = isinstance(value, list) and self.item is not None and self.item.item is not None
        return not rows or any(isinstance(each, list) for each in value)

    def _nothing(self) -> Any:
        if list in self.kinds and not (self.filled and NoneType in self.kinds):
            return []
        if self.entry is not None:
            return {}
        return None if NoneType in self.kinds else ABSENT


class RequestModel(StrictModel):
    """Base class of requests that clients send as JSON."""

    @model_validator(mode="before")
    @classmethod
    def _add_brackets(cls, content: Any) -> Any:
        if not isinstance(content, dict):
            return content
        shapes, read = _shapes(cls), content
        for name, value in content.items():
            shape = shapes.get(name)
            found = value if shape is None else shape.read(value)
            if found is value or (found is ABSENT and keys_of(cls)[name].is_required()):
                continue
            read = dict(content) if read is content else read
            read[name] = found
            if found is ABSENT:
                del read[name]
        return read


@cache
def _shapes(model: type[BaseModel]) -> Mapping[str, JsonShape]:
    found = {}
    for name, field in model.model_fields.items():
        annotation: Any = field.annotation
        if isinstance(annotation, ForwardRef):  # the type was defined after the model
            annotation = get_type_hints(model, include_extras=True)[name]
        shape = _shape(annotation)
        found[field.alias or name] = replace(shape, filled=shape.filled or _has_items(field.metadata))
    return found


def _has_items(metadata: Any) -> bool:
    return any(
        getattr(each, "min_length", None) or _has_items(getattr(each, "metadata", ())) for each in metadata
    )


def _shape(annotation: Any) -> JsonShape:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        shape = _shape(arguments[0])
        return replace(shape, filled=shape.filled or _has_items(arguments[1:]))
    if origin in (Union, UnionType):
        return _either([_shape(each) for each in arguments])
    if origin is list:
        return JsonShape(frozenset({list}), item=_shape(arguments[0]))
    if origin is dict:
        return JsonShape(frozenset({dict}), entry=_shape(arguments[1]))
    if origin is Literal:
        return JsonShape(frozenset(map(type, arguments)))
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return JsonShape(frozenset({dict, annotation}))
    return JsonShape(frozenset({int, float} if annotation in (int, float) else {annotation}))


def _either(shapes: list[JsonShape]) -> JsonShape:
    return JsonShape(
        frozenset().union(*(each.kinds for each in shapes)),
        next((each.item for each in shapes if each.item is not None), None),
        next((each.entry for each in shapes if each.entry is not None), None),
        any(each.filled for each in shapes),
    )
