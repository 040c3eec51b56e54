"""The driver of Robotiq's adaptive grippers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from cobot.clock import SYSTEM
from cobot.grippers.modbus import SOCKET, Master
from cobot.grippers.protocol import (
    Grasp,
    GripperCapabilities,
    GripperError,
    GripperOptions,
    GripperState,
    HeldObject,
    IoPort,
    Now,
    PowerLoss,
)
from cobot.grippers.robotiq.link import GripperLink, ModbusLink
from cobot.grippers.robotiq.registers import (
    FAULTS,
    FULL,
    MODELS,
    NOT_ACTIVE,
    PASSING,
    Activation,
    Detection,
    Request,
    RobotiqStatus,
    share,
)
from cobot.grippers.robotiq.rig import RobotiqRig
from cobot.grippers.robotiq.urcap import PORT, UrcapLink
from cobot.strict import shown

BEYOND_M = 0.003
"""A grasp aims this distance beyond the narrowest permitted object, m, because the fingers must press on
it.
"""
NEAR = 2
"""If the fingers stop within this number of counts of the commanded position, they have reached it and hold
nothing.
"""
ACTIVATION_S = 15.0
"""Timeout for an activation, s."""
RESETS = 20
"""Maximum number of times that the driver asks whether the activation has been reset, before it activates the
gripper.
"""
INACTIVE = "the gripper is not activated: POST /robot/gripper/home, which closes and opens its fingers"


class RobotiqOptions(GripperOptions):
    """Options of `RobotiqGripper`."""

    device: Annotated[
        str,
        Field(
            min_length=1,
            max_length=200,
            description="Serial port such as /dev/ttyUSB0, or HOST:PORT for RTU over TCP; for urcap the "
            f"address of the robot's controller, HOST or HOST:PORT (default port {PORT}).",
        ),
    ]
    protocol: Annotated[
        Literal["rtu", "urcap"],
        Field(description="Modbus RTU, or the text protocol of the URCap in the robot's controller."),
    ] = "rtu"
    model: Annotated[Literal["2f85", "2f140", "hande"], Field(description="Model of the gripper.")] = "2f85"
    unit: Annotated[int, Field(ge=1, le=247, description="Modbus address of the gripper.")] = 9
    baud: Annotated[int, Field(ge=1200, le=1_000_000, description="Baud rate of the serial port.")] = 115_200
    timeout_s: Annotated[float, Field(ge=0.01, le=2.0, description="Timeout for each answer, s.")] = 0.2
    open_count: Annotated[
        int, Field(ge=0, le=FULL, description="Position that the gripper reports when open.")
    ] = 0
    closed_count: Annotated[
        int, Field(ge=0, le=FULL, description="Position that the gripper reports when closed.")
    ] = FULL
    stroke: Annotated[
        float | None, Field(gt=0.0, le=1.0, description="Width when open, m; null: that of the model.")
    ] = None
    default_speed: Annotated[
        float,
        Field(
            ge=0.0, le=1.0, description="Speed of a command without a speed, from 0 (slowest) to 1 (fastest)."
        ),
    ] = 1.0
    default_force: Annotated[
        float,
        Field(
            ge=0.0,
            le=1.0,
            description="Force of a command without a force, from 0 (smallest) to 1 (largest).",
        ),
    ] = 0.3

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.closed_count <= self.open_count:
            raise ValueError(
                f"closed_count is {self.closed_count}; it must be above open_count, {self.open_count}"
            )
        if self.protocol == "rtu":
            if not self.device.startswith("/") and not _is_address(self.device, with_port=True):
                raise ValueError(
                    f"device is {shown(self.device)}; it must be a path such as /dev/ttyUSB0, or HOST:PORT"
                )
            return self
        if given := sorted({"unit", "baud"} & self.model_fields_set):
            raise ValueError(f"{given[0]} is for protocol rtu, but the protocol is urcap; leave it out")
        if not _is_address(self.device, with_port=False):
            raise ValueError(f"device is {shown(self.device)}; with urcap it must be HOST or HOST:PORT")
        return self


def _is_address(text: str, *, with_port: bool) -> bool:
    """Whether a text is HOST:PORT. Without `with_port`, HOST alone is also allowed."""
    host, colon, port = text.removeprefix(SOCKET).rpartition(":")
    if not colon:
        return not with_port and bool(port) and "/" not in port
    return bool(host) and not set("/:") & set(host) and port.isdecimal() and 0 < int(port) < 65536


class RobotiqGripper:
    """The driver for Robotiq's grippers, see the package. Connecting moves nothing. `home` activates a
    gripper that is not activated.
    """

    Options = RobotiqOptions
    state_period_s = 0.005

    def __init__(
        self,
        options: RobotiqOptions,
        port: IoPort,
        clock: Now = SYSTEM,
        connect: Callable[[], Any] | None = None,
    ) -> None:
        """
        Args:
            connect: creates a connection that tests use instead of one to `options.device`.
        """
        self._options = options
        self._clock = clock
        model = MODELS[options.model]
        self._stroke_m = options.stroke or model.stroke_m
        self._speed_m_s, self._force_n = model.speed_m_s, model.force_n
        self._link: GripperLink
        if options.protocol == "urcap":
            self._link = UrcapLink(options.device, options.timeout_s, connect)
        else:
            self._link = ModbusLink(
                Master(options.device, options.unit, options.baud, options.timeout_s, connect)
            )
        self._request: Request | None = None
        self._activating_since_s: float | None = None
        self.capabilities = GripperCapabilities(
            width_m=(0.0, self._stroke_m),
            force_n=model.force_n,
            speed_m_s=model.speed_m_s,
            object_detection=True,
            on_power_loss=PowerLoss.KEEPS,
        )

    def connect(self) -> None:
        self._link.open()
        self._request = self._link.request() if self._request else None
        self._link.status()

    def disconnect(self) -> None:
        self._link.close()

    def open(self) -> None:
        self.move(self._stroke_m, None, None)

    def close(self) -> None:
        self.move(0.0, None, None)

    def move(self, width: float, speed: float | None, force: float | None) -> None:
        if self._status().activation is not Activation.COMPLETE:
            raise GripperError(INACTIVE)
        self._request_move(width, speed, force)

    def grasp(self, grasp: Grasp) -> None:
        status = self._status()
        if status.activation is not Activation.COMPLETE:
            raise GripperError(INACTIVE)
        present_m = self._width_m(status.position)
        if grasp.width is not None and grasp.width > present_m:
            target_m = grasp.width + grasp.tolerance_outer + BEYOND_M
        else:
            target_m = 0.0 if grasp.width is None else grasp.width - grasp.tolerance_inner - BEYOND_M
        self._request_move(target_m, grasp.speed, grasp.force)

    def release(self, width: float | None) -> None:
        self.move(self._stroke_m if width is None else width, None, None)

    def stop(self) -> None:
        status = self._status()
        if status.go and status.detection is Detection.MOVING:
            self._send(Request(True, False, status.echo, *self._rates(None, None)))

    def home(self) -> None:
        """Activate the gripper. If it is already activated, open it."""
        if self._status().activation is Activation.COMPLETE:
            self.open()
            return
        self._send(Request(False, False))
        for _ in range(RESETS):
            if self._status().activation is Activation.RESET:
                break
        self._send(Request(True, False))
        self._activating_since_s = self._clock.now_s()

    def state(self) -> GripperState:
        status = self._status()
        width = self._width_m(status.position)
        if status.activation is not Activation.COMPLETE:
            begun_s = self._activating_since_s
            begins = begun_s is not None and self._clock.now_s() - begun_s < ACTIVATION_S
            fault = "" if status.fault in (*PASSING, NOT_ACTIVE) else _words(status.fault)
            moving = not fault and (begins or status.activation is Activation.IN_PROGRESS)
            fault = fault or ("" if moving else INACTIVE)
            return GripperState(width, None, moving, object=HeldObject.NONE, fault=fault)
        self._activating_since_s = None
        target, request = status.echo, self._request
        late = request is not None and request.go and request.position != status.echo
        moving = late or (status.go and status.detection is Detection.MOVING)
        held = HeldObject.NONE
        if not moving and abs(status.position - target) > NEAR:
            if status.detection is Detection.STOPPED_CLOSING:
                held = HeldObject.HELD_INSIDE
            elif status.detection is Detection.STOPPED_OPENING:
                held = HeldObject.HELD_OUTSIDE
        fault = "" if status.fault in PASSING else _words(status.fault)
        commanded_m = self._width_m(request.position if request is not None and late else target)
        force_n = None
        if held.is_held and request is not None:
            least, most = self._force_n
            force_n = least + (most - least) * request.force / FULL
        return GripperState(width, commanded_m, moving, force=force_n, object=held, fault=fault)

    def _status(self) -> RobotiqStatus:
        return self._link.status()

    def _request_move(self, width_m: float, speed_m_s: float | None, force_n: float | None) -> None:
        self._send(Request(True, True, self._count(width_m), *self._rates(speed_m_s, force_n)))

    def _rates(self, speed_m_s: float | None, force_n: float | None) -> tuple[int, int]:
        options = self._options
        speed = (
            round(FULL * options.default_speed) if speed_m_s is None else share(speed_m_s, self._speed_m_s)
        )
        force = round(FULL * options.default_force) if force_n is None else share(force_n, self._force_n)
        return speed, force

    def _send(self, request: Request) -> None:
        self._link.send(request)
        self._request = request

    def _count(self, width_m: float) -> int:
        options = self._options
        closed = 1.0 - max(0.0, min(1.0, width_m / self._stroke_m))
        return round(options.open_count + closed * (options.closed_count - options.open_count))

    def _width_m(self, count: int) -> float:
        options = self._options
        closed = (count - options.open_count) / (options.closed_count - options.open_count)
        return self._stroke_m * max(0.0, min(1.0, 1.0 - closed))

    @staticmethod
    def contract_rig(options: RobotiqOptions) -> RobotiqRig:
        return RobotiqRig(options)


def _words(fault: int) -> str:
    """The active fault as text; "" if there is none."""
    return FAULTS.get(fault, f"fault {fault:#04x}, which the manual does not list" if fault else "")
