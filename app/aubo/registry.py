"""Vendor services. Each is a typed function that is registered once and served over every transport.

A class module registers its functions, and each transport calls them by class and method:

    @service("RobotConfig")
    async def get_dof(robot: Services) -> int: ...             # /{robot}/RobotConfig/getDof, GetDof.srv

    answer = await call(robot, "RobotConfig", "getDof", {})  # VendorAnswer(code=0, message="", result=7)

The first parameter is the robot's `Services`. If the second one is called `origin`, it gets the call's
`CallOrigin`. All others are fields of the request. Their types are bool, int (int32), Int64, float, str,
list[...] of bool, int, float or str, and Json. Json is a string in the message; the function takes and
returns the decoded content. The docstring describes each field in `Args:` with its unit, and the result in
`Returns:`. The answer of a function without a result is an int32 of 0.
"""

from __future__ import annotations

import inspect
import json
import logging
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from app.aubo.fields import MAX_INTEGER, REQUIRED, Int64, Json, ServiceField, argument
from app.aubo.roles import needs_control, role_of
from app.aubo.signatures import Function, find_kind, make_field, parse_docstring
from cobot import audit
from cobot.access.roles import Role
from cobot.codes import Code, code_of
from cobot.errors import CobotError, InputError, exhausted
from cobot.strict import shown, unknown_key

if TYPE_CHECKING:
    from app.robot_services import Services

__all__ = [
    "REGISTRY",
    "CallOrigin",
    "Int64",
    "Json",
    "ServiceField",
    "VendorAnswer",
    "VendorService",
    "call",
    "service",
]

log = logging.getLogger("cobot.vendor")


@dataclass(frozen=True, slots=True)
class VendorService:
    """A registered function.

    Attributes:
        doc: one or more sentences, without the description of the fields.
        parameters: the request, in the function's order.
        result: named "result".
        takes_origin: whether the function takes a `CallOrigin`.
    """

    robot_class: str
    method: str
    doc: str
    parameters: tuple[ServiceField, ...]
    result: ServiceField
    function: Function
    takes_origin: bool

    @property
    def type_name(self) -> str:
        """The name of the .srv file, which is the method's name. If two classes have methods with this name
        but different fields, it is prefixed with the class.
        """
        return _type_names(len(REGISTRY))[self.robot_class, self.method]

    @property
    def role(self) -> Role:
        """The role that the caller needs."""
        return role_of(self.robot_class, self.method)

    @property
    def changes(self) -> bool:
        """Whether the service may change something. Calls of such services are written to the audit log."""
        reads = self.robot_class in CALCULATIONS or READS.match(self.method) is not None
        return not reads and self.method not in POINTS

    @property
    def signature(self) -> tuple[Any, ...]:
        """The request and result fields, which are equal for services that share a .srv file."""
        return tuple((field.name, field.ros_type) for field in (*self.parameters, self.result))


@dataclass(frozen=True, slots=True)
class CallOrigin:
    """The origin of a call, for services that move the arm.

    Attributes:
        name: displayed name, such as "POST /iiwa/MotionControl/moveJoint".
        stops: `Ownership.stops` when the request came in. If this number has changed since, the call's motion
            is stopped.
        token: the token of the sequence that sent the call; None if another client sent it.
    """

    name: str
    stops: int
    token: str | None = None


@dataclass(frozen=True, slots=True)
class VendorAnswer:
    """The answer of every service. A `code` of 0 means success, see `cobot.codes`."""

    code: int
    message: str
    result: Any


CALCULATIONS = ("Math", "RobotAlgorithm")
READS = re.compile(r"get|is[A-Z]|has|peek|(axisGroup|frame|modbus|serial|socket)(Get|Read|Convert)")
"""`CALCULATIONS` has the classes whose methods all change nothing. `READS` matches such methods of the other
classes by their prefix.
"""
TOO_LARGE = "the numbers are too large: the result is not finite"
POINTS = ("servoJoint", "servoCartesian")
"""Services that send points. The audit log has one entry for their session, not one for each point."""

REGISTRY: dict[tuple[str, str], VendorService] = {}
"""All services by (class, method). Complete once `app.aubo.classes` is imported."""


def service(robot_class: str, *, name: str | None = None) -> Callable[[Function], Function]:
    """Register a function as a service of a class. The method's name is the function's name in camelCase, or
    `name`.

    Raises:
        TypeError: a programming error: a service cannot have this signature or docstring.
    """

    def register(function: Function) -> Function:
        found = _described(robot_class, name or camel_case(function.__name__), function)
        key = found.robot_class, found.method
        if key in REGISTRY:
            raise TypeError(f"{robot_class}/{found.method} is registered twice")
        REGISTRY[key] = found
        return function

    return register


async def call(
    robot: Services,
    robot_class: str,
    method: str,
    arguments: dict[str, Any],
    origin: CallOrigin | None = None,
) -> VendorAnswer:
    """Call a service with the fields of a request. Never raises, except when cancelled.

    Args:
        origin: origin of the call; None if it is unknown.
    """
    found = REGISTRY.get((robot_class, method))
    if found is None:
        return VendorAnswer(Code.NOT_FOUND, unknown_service(robot_class, method), None)
    try:
        bound = bind(found, arguments)
    except InputError as exc:
        return failed(found, Code.INPUT, str(exc))
    return await run(robot, found, bound, origin)


async def run(
    robot: Services, found: VendorService, bound: dict[str, Any], origin: CallOrigin | None = None
) -> VendorAnswer:
    """Call a service with arguments from `bind`."""
    if not found.changes or audit.trail.get() is None:
        return await _run(robot, found, bound, origin)
    where, arguments = f"{robot.robot.name}/{found.robot_class}/{found.method}", shown(bound)
    answer = await _run(robot, found, bound, origin)
    outcome = "ok"
    if answer.code != Code.OK:
        outcome = f"{int(answer.code)}: {answer.message}"
        audit.report_refusal(where, Code(answer.code).name.lower(), answer.message)
    audit.note(where, outcome, arguments=arguments)
    return answer


async def _run(
    robot: Services, found: VendorService, bound: dict[str, Any], origin: CallOrigin | None
) -> VendorAnswer:
    where = f"{found.robot_class}/{found.method}"
    if found.takes_origin:
        bound["origin"] = origin or CallOrigin(where, robot.ownership.stops)
    try:
        if needs_control(found.robot_class, found.method):
            robot.ownership.require_control()
        value = found.function(robot, **bound)
        if inspect.isawaitable(value):
            value = await value
        return VendorAnswer(Code.OK, "", _result(found, value))
    except CobotError as exc:
        return failed(found, code_of(exc), str(exc))
    except Exception as exc:  # no traceback reaches a client
        if error := exhausted(exc):
            log.error("%s: %s", where, error)
            return failed(found, code_of(error), str(error))
        log.error("%s failed", where, exc_info=exc)
        return failed(found, Code.ERROR, "an error in cobot itself; its log has the details")


def failed(found: VendorService, code: Code, message: str) -> VendorAnswer:
    """Return the answer to a call that has failed."""
    return VendorAnswer(code, message, int(code) if found.result.kind in MAX_INTEGER else found.result.empty)


def unknown_service(robot_class: str, method: str) -> str:
    """Return the message for an unknown service, which lists the valid ones."""
    classes = sorted({key[0] for key in REGISTRY})
    if robot_class not in classes:
        return f"there is no class {shown(robot_class)}; valid names: {', '.join(classes)}"
    methods = sorted(key[1] for key in REGISTRY if key[0] == robot_class)
    return f"{robot_class}: {unknown_key(method, methods, 'method')}"


def bind(found: VendorService, arguments: Any) -> dict[str, Any]:
    """Return the function's arguments, validated and completed with defaults.

    Raises:
        InputError: an argument is invalid. The error has the field, the problem and the valid values.
    """
    if not isinstance(arguments, dict):
        raise InputError(f"the request must be an object, got {shown(arguments)}")
    names = [field.name for field in found.parameters]
    for key in arguments:
        if key not in names:
            raise InputError(unknown_key(str(key), names) if names else f"takes no field, got {shown(key)}")
    missing = [f.name for f in found.parameters if f.name not in arguments and f.default is REQUIRED]
    if missing:
        raise InputError(f"{missing[0]}: is missing; required: {', '.join(missing)}")
    return {field.name: argument(field, arguments) for field in found.parameters}


def camel_case(name: str) -> str:
    """Return the name in camelCase: getDof for get_dof."""
    first, *others = name.split("_")
    return first + "".join(word[:1].upper() + word[1:] for word in others)


def _result(found: VendorService, value: Any) -> Any:
    """Return the result in the form of an answer.

    Raises:
        InputError: the arguments are so large that the result is not finite.
    """
    kind = found.result.kind
    if kind == "json":
        try:
            return json.dumps(value, separators=(",", ":"), allow_nan=False)
        except ValueError as exc:
            raise InputError(TOO_LARGE) from exc
    result: Any = list(value) if kind.endswith("[]") else 0 if value is None else value
    numbers = result if kind == "float64[]" else [result] if kind == "float64" else []
    if not all(map(math.isfinite, numbers)):
        raise InputError(TOO_LARGE)
    return result


def _described(robot_class: str, method: str, function: Function) -> VendorService:
    where = f"{robot_class}/{method}"
    summary, documented, returns = parse_docstring(where, function)
    signature = inspect.signature(function)
    _, *parameters = signature.parameters.values()
    takes_origin = bool(parameters) and parameters[0].name == "origin"
    fields = tuple(make_field(where, p, function, documented) for p in parameters[takes_origin:])
    surplus = set(documented) - {field.name for field in fields} - {"origin", "robot"}
    if surplus:
        raise TypeError(
            f"{where}: its docstring describes {', '.join(sorted(surplus))}, but the function has no such "
            f"parameter"
        )
    kind = find_kind(where, "its result", signature.return_annotation, function)
    if not returns and signature.return_annotation not in (None, "None"):
        raise TypeError(f"{where}: its docstring has no Returns:")
    result = ServiceField("result", kind, returns or "0, or the code of the error")
    return VendorService(
        robot_class=robot_class,
        method=method,
        doc=summary,
        parameters=fields,
        result=result,
        function=function,
        takes_origin=takes_origin,
    )


@cache
def _type_names(registered: int) -> dict[tuple[str, str], str]:
    by_method: dict[str, list[VendorService]] = {}
    for found in REGISTRY.values():
        by_method.setdefault(found.method, []).append(found)
    names = {}
    for method, services in by_method.items():
        differ = len({found.signature for found in services}) > 1
        for found in services:
            prefix = found.robot_class if differ else ""
            names[found.robot_class, method] = prefix + method[:1].upper() + method[1:]
    return names
