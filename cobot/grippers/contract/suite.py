"""All gripper checks and their results.

They run on a simulated device, which the driver class creates with `contract_rig(options)`. The device uses a
simulated clock instead of waiting, and never moves real fingers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from pydantic import ValidationError

from cobot.config import Settings
from cobot.contract_checks import CheckResult, ContractError, NotTested, result_of
from cobot.errors import ConfigError
from cobot.grippers.protocol import (
    Grasp,
    Gripper,
    GripperCapabilities,
    GripperError,
    GripperOptions,
    GripperState,
    HeldObject,
    IoPort,
    Range,
)
from cobot.grippers.registry import gripper_class, gripper_options, gripper_section
from cobot.strict import sentence

STEP_S, END_S = 0.01, 30.0
NEAR_M = 0.003
UNKNOWN = "no_such_option"


class GripperRig(Protocol):
    """Interface of a simulated device that can simulate faults.

    Attributes:
        faults: the faults that the device can simulate: "disconnect" (it does not answer) and "fault" (it
            reports a fault).
    """

    faults: frozenset[str]

    def gripper(self, port: IoPort) -> Gripper:
        """Create one more driver for the same device."""
        ...

    def step(self, duration_s: float) -> None:
        """Advance the device's clock."""
        ...

    def place(self, width_m: float | None) -> None:
        """Put an object between the fingers, or remove it."""
        ...

    def inject(self, fault: str) -> None:
        """Start a fault, which lasts until `clear`."""
        ...

    def clear(self, fault: str) -> None:
        """End a fault."""
        ...


class NoPoints:
    """A robot without inputs and outputs. If a driver needs them, its rig passes its own port."""

    def read(self, name: str) -> float:
        raise GripperError(f"the robot has no input or output {name!r}")

    def set(self, name: str, value: float) -> None:
        self.read(name)


class Subject:
    """The tested class, with its options and its rig."""

    def __init__(self, kind: Any, options: GripperOptions) -> None:
        self.kind, self.options = kind, options
        if not hasattr(kind, "contract_rig"):
            raise ConfigError(
                "the class has no contract_rig: nothing can be tested without a simulated device"
            )
        self.rig: GripperRig = kind.contract_rig(options)
        self.gripper = self.connect()

    def connect(self) -> Gripper:
        made = self.rig.gripper(NoPoints())
        made.connect()
        return made

    def prepare(self) -> GripperCapabilities:
        """Connect, activate the gripper if this is necessary, and open it without an object."""
        self.gripper.home()
        self.until_still("home")
        self.gripper.open()
        self.until_still("open")
        return self.gripper.capabilities

    def until_still(self, what: str) -> GripperState:
        """Wait until the fingers no longer move, and return the state."""
        time_s = 0.0
        while (state := self.gripper.state()).moving:
            self.rig.step(STEP_S)
            time_s += STEP_S
            require(time_s < END_S, f"{what}: the fingers still move after {END_S:g} s")
        require(not state.fault, f"{what}: the gripper reports a fault: {state.fault}")
        return state

    def hold(self, width_m: float | None) -> GripperState:
        """Place an object and grasp it. `width_m` is None for a gripper without a width."""
        self.rig.place(width_m or 0.0)
        self.gripper.grasp(Grasp(width_m, 0.005, 0.005))
        return self.until_still("grasp")


def require(condition: object, words: str) -> None:
    """Raise a ContractError with this text if the condition does not hold."""
    if not condition:
        raise ContractError(words)


def options(subject: Subject) -> str:
    """An unknown option is rejected, and the error names it."""
    given = subject.options.model_dump()
    try:
        type(subject.options).model_validate({**given, UNKNOWN: 1})
    except ValidationError as exc:
        words = "; ".join(sentence(each) for each in exc.errors())
        require(UNKNOWN in words, f"the error does not name {UNKNOWN}: {words}")
        return "an unknown option is rejected"
    raise ContractError("an unknown option is not rejected: derive Options from GripperOptions")


def capabilities(subject: Subject) -> str:
    """The attribute `capabilities` is a `GripperCapabilities`."""
    able = subject.gripper.capabilities
    require(isinstance(able, GripperCapabilities), "capabilities is not a GripperCapabilities")
    return able.words


def connect(subject: Subject) -> str:
    """Connecting and disconnecting move nothing, even if each of them is done twice."""
    subject.prepare()
    before = subject.gripper.state().width
    for _ in range(2):
        subject.gripper.disconnect()
    subject.gripper.connect()
    subject.rig.step(1.0)
    require(subject.gripper.state().width == before, "the fingers moved while the driver connected")
    return "connecting moves nothing"


def move(subject: Subject) -> str:
    """During a move, `moving` is true until the fingers reach the width."""
    able = subject.prepare()
    least, most = _widths(able)
    width = least if not able.continuous else 0.5 * (least + most)
    subject.gripper.move(width, None, None)
    require(subject.gripper.state().moving, "moving is false directly after a command has returned")
    state = subject.until_still("move")
    require(
        state.width is None or abs(state.width - width) <= NEAR_M, f"width is {state.width}, not {width:g}"
    )
    commanded = state.commanded_width
    require(commanded is None or abs(commanded - width) <= NEAR_M, f"commanded_width is {commanded}")
    return f"the fingers move to {width:g} m, and the driver reports it"


def preempt(subject: Subject) -> str:
    """A command replaces a running one."""
    least, most = _widths(subject.prepare())
    subject.gripper.move(least, None, None)
    subject.rig.step(STEP_S)
    subject.gripper.move(most, None, None)
    state = subject.until_still("move")
    require(state.width is None or abs(state.width - most) <= NEAR_M, f"width is {state.width}, not {most:g}")
    return "a new command replaces the running one"


def stop(subject: Subject) -> str:
    """A stop ends the motion, and the fingers stay where they stopped."""
    able = subject.prepare()
    least, _ = _widths(able)
    if not able.continuous:
        raise NotTested("the fingers of this gripper cannot stop between their end positions")
    subject.gripper.move(least, able.speed_m_s and able.speed_m_s[0], None)
    subject.rig.step(0.1)
    subject.gripper.stop()
    width = subject.until_still("stop").width
    subject.rig.step(1.0)
    require(subject.gripper.state().width == width, "the fingers moved after the stop")
    require(width is None or width > least, "the fingers reached the end of their travel before they stopped")
    return "a stop stops"


def grasp(subject: Subject) -> str:
    """A grasp holds an object. A stop or a new connection does not release the object, and a release lets it
    go.
    """
    width = _detectable(subject)
    state = subject.hold(width)
    require(state.object is HeldObject.HELD_INSIDE, f"object is {state.object}, not held_inside")
    subject.gripper.stop()
    subject.rig.step(0.5)
    require(subject.gripper.state().object is HeldObject.HELD_INSIDE, "a stop released the object")
    subject.gripper.disconnect()
    subject.gripper = subject.connect()
    found = subject.gripper.state().object
    require(
        found is HeldObject.HELD_INSIDE,
        f"after a new connection the driver reports {found} instead of the held object",
    )
    subject.gripper.release(None)
    state = subject.until_still("release")
    require(state.object is HeldObject.NONE, f"object is {state.object} after a release")
    return f"an object{f' of {width:g} m' if width else ''} is held, kept and released"


def grasp_nothing(subject: Subject) -> str:
    """A grasp without an object reports that nothing is held."""
    width = _detectable(subject)
    subject.rig.place(None)
    subject.gripper.grasp(Grasp(width, 0.005, 0.005))
    state = subject.until_still("grasp")
    require(
        state.object is HeldObject.NONE, f"object is {state.object} although nothing is between the fingers"
    )
    return "a grasp without an object holds nothing"


def lose(subject: Subject) -> str:
    """If the object is pulled out, the driver reports that it is no longer held."""
    subject.hold(_detectable(subject))
    subject.rig.place(None)
    subject.rig.step(END_S)
    found = subject.gripper.state().object
    require(found in (HeldObject.NONE, HeldObject.LOST), f"object is {found} although the object is gone")
    return "the loss of an object is reported"


def disconnect(subject: Subject) -> str:
    """A device that does not answer causes a GripperError with a message, and can be used again later."""
    _injectable(subject, "disconnect")
    subject.prepare()
    subject.rig.inject("disconnect")
    for call in (subject.gripper.state, subject.gripper.open):
        try:
            call()
        except GripperError as exc:
            require(len(str(exc)) > len("error"), "the error has no message")
        else:
            raise ContractError(
                f"{call.__name__} does not raise a GripperError while the device does not answer"
            )
    subject.gripper.disconnect()
    subject.rig.clear("disconnect")
    subject.gripper.connect()
    subject.gripper.state()
    return "a lost device causes an error with a message, and can be used again"


def fault(subject: Subject) -> str:
    """A fault of the device appears in `state().fault`, and disappears with its cause."""
    _injectable(subject, "fault")
    subject.prepare()
    subject.rig.inject("fault")
    require(subject.gripper.state().fault, "state().fault is empty although the device has a fault")
    subject.rig.clear("fault")
    require(not subject.gripper.state().fault, "state().fault stays although the fault has ended")
    return "a fault is reported as text"


CHECKS: dict[str, Callable[[Subject], str]] = {
    "options": options,
    "capabilities": capabilities,
    "connect": connect,
    "move": move,
    "preempt": preempt,
    "stop": stop,
    "grasp": grasp,
    "missed": grasp_nothing,
    "lost": lose,
    "disconnect": disconnect,
    "fault": fault,
}


def subject_for(settings: Settings, name: str, given: dict[str, Any]) -> Callable[[], Subject]:
    """A function that creates the subject of a check.

    Args:
        given: options, if the settings have none for this gripper.

    Raises:
        ConfigError: the gripper or one of its options does not exist.
    """
    section = gripper_section(settings)
    kind: Any = gripper_class(name)
    if section is not None and section.type == name and not given:
        found = gripper_options(settings)
    else:
        try:
            found = getattr(kind, "Options", GripperOptions).model_validate(given)
        except ValidationError as exc:
            words = "; ".join(sentence(each) for each in exc.errors())
            raise ConfigError(f"{name}: {words}; give its options by --config or --option") from exc
    return lambda: Subject(kind, found)


def examine(make: Callable[[], Subject], check: str) -> CheckResult:
    """Run one check on a new device."""
    return result_of(check, lambda: CHECKS[check](make()), GripperError)


def _widths(able: GripperCapabilities) -> Range:
    if able.width_m is None:
        raise NotTested("this gripper has no width")
    return able.width_m


def _detectable(subject: Subject) -> float | None:
    able = subject.prepare()
    if not able.object_detection:
        raise NotTested("this gripper does not detect objects")
    return None if able.width_m is None else 0.5 * sum(able.width_m)


def _injectable(subject: Subject, name: str) -> None:
    if name not in subject.rig.faults:
        raise NotTested(f"the simulated device cannot simulate the fault {name}")
