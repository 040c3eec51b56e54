"""Options of `type: ros2_control` in `robot.backend`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from cobot.config import RosSection, Settings
from cobot.errors import ConfigError
from cobot.ros.driver_io import DRIVERS, DriverIo
from cobot.types import JointLimits
from rtloop.backends.protocols import BackendOptions

NAME = r"[A-Za-z_][A-Za-z0-9_]*"
Namespace = Annotated[str, Field(pattern=rf"^(/{NAME})*$", max_length=200)]
Absolute = Annotated[str, Field(pattern=rf"^(/{NAME})+$", max_length=200)]
Relative = Annotated[str, Field(pattern=rf"^/?{NAME}(/{NAME})*$", max_length=200)]
JointName = Annotated[str, Field(min_length=1, max_length=200)]
IoName = Annotated[str, Field(pattern=r"^[^/\x00-\x1f]{1,60}$")]
Interface = Annotated[str, Field(pattern=r"^[^\s/]+(/[^\s/]+)+$", max_length=200)]
"""Name of a GPIO and of its interface: GPIO/INTERFACE."""
MAX_IO = 64
GPIO = "gpio"
if TYPE_CHECKING:
    Io = str
else:
    Io = Literal[GPIO, *DRIVERS]
CONTROLLER = "gpio_command_controller"
"""Default of `gpio_controller` for a GPIO controller."""
Seconds = Annotated[float, Field(gt=0.0, le=60.0)]
Tolerance = Annotated[float, Field(gt=0.0, le=1.0)]


class Ros2ControlOptions(BackendOptions):
    """Options of an arm that ros2_control controls. The DDS domain and the networks are set in the section
    `ros` of the settings.

    Attributes:
        namespace: namespace of the controllers, such as /left; "" for none.
        controller: name of the joint trajectory controller; None for the active controller that moves these
            joints.
        action: name of the controller's action, if it is not NAMESPACE/CONTROLLER/follow_joint_trajectory.
        controller_manager: controller manager name below the namespace.
        joint_states: topic of the joint states; below the namespace if it does not begin with a slash.
        joints: the arm's joint names in ROS, in the arm's order; None for the names in the model.
        prefix: prefix of each joint name in ROS.
        measured: quantities that joint_states contains besides positions.
        path_tolerance_rad, goal_tolerance_rad, goal_time_s: tolerances that are sent with each goal. With
            None or 0 the controller uses its own tolerances.
        max_points: maximum number of points of a goal; longer motions are resampled.
        resampling_rad: maximum deviation that resampling may cause, rad.
        min_rate_hz: minimum rate of joint_states, Hz.
        state_timeout_s: maximum age of a joint state, s.
        answer_timeout_s: timeout for the answer to a goal or to a cancel request, s.
        result_timeout_s: timeout for the result after the end of a motion, s.
        connect_s: timeout for the driver when the backend is opened or reset, s.
        speed_scaling: topic of the speed slider, of type std_msgs/Float64.
        speed_scaling_full: value of the speed slider at full speed. None means 100 if a value above 1 has
            been received, otherwise 1, because drivers differ.
        io: where the inputs and outputs are: at a GPIO controller of ros2_controllers, or at a driver with
            its own services.
        gpio_controller: the GPIO controller's name, or the name prefix of the driver's services; None for the
            usual name.
        inputs, outputs: interfaces by the names that cobot gives them. An interface is written as
            GPIO/INTERFACE, or as defined in `cobot.ros.driver_io`.
        analog: names of inputs and outputs whose values are numbers; the others are true or false.
    """

    namespace: Namespace = ""
    controller: JointName | None = None
    action: Absolute | None = None
    controller_manager: Relative = "controller_manager"
    joint_states: Relative = "joint_states"
    joints: list[JointName] | None = None
    prefix: Annotated[str, Field(max_length=200)] = ""
    measured: tuple[Literal["velocity", "effort"], ...] = Field(("velocity",), strict=False)
    path_tolerance_rad: Tolerance | None = None
    goal_tolerance_rad: Tolerance | None = None
    goal_time_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0
    max_points: Annotated[int, Field(ge=10, le=100_000)] | None = None
    resampling_rad: Annotated[float, Field(gt=0.0, le=0.01)] = 1e-3
    min_rate_hz: Annotated[float, Field(ge=1.0, le=1000.0)] = 10.0
    state_timeout_s: Annotated[float, Field(ge=0.02, le=10.0)] = 0.5
    answer_timeout_s: Seconds = 2.0
    result_timeout_s: Seconds = 5.0
    connect_s: Seconds = 5.0
    speed_scaling: Relative = "speed_scaling_state_broadcaster/speed_scaling"
    speed_scaling_full: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    io: Io = GPIO
    gpio_controller: Relative | None = None
    inputs: dict[IoName, Interface] = Field(default_factory=dict, max_length=MAX_IO)
    outputs: dict[IoName, Interface] = Field(default_factory=dict, max_length=MAX_IO)
    analog: list[IoName] = Field(default_factory=list)

    @model_validator(mode="after")
    def _check_io(self) -> Self:
        if both := sorted(set(self.inputs) & set(self.outputs)):
            raise ValueError(f"{both[0]!r} is the name of both an input and an output; rename one of them")
        if unknown := sorted(set(self.analog) - set(self.inputs) - set(self.outputs)):
            raise ValueError(f"analog: {unknown[0]!r} is neither in inputs nor in outputs")
        if self.io != GPIO:
            self._check_driver(DRIVERS[self.io])
        return self

    def _check_driver(self, driver: DriverIo) -> None:
        for name, place in {**self.inputs, **self.outputs}.items():
            kind = driver.kind(place)
            if kind is None or (name in self.outputs and not driver.can_set(place)):
                raise ValueError(
                    f"{name!r} is {place}; with io: {self.io} the valid values are {driver.valid()}"
                )
            if kind[0].is_analog != (name in self.analog):
                what = "a number: add it to" if kind[0].is_analog else "true or false: remove it from"
                raise ValueError(f"{name!r} is {place}, whose value is {what} analog")

    @property
    def io_names_begin(self) -> str:
        """The GPIO controller's full name, or the name prefix of the driver's services."""
        usual = CONTROLLER if self.io == GPIO else DRIVERS[self.io].below
        name = self.gpio_controller or usual
        return self.namespace if name is None else self.below(name)

    def below(self, name: str) -> str:
        """Put a name below the namespace. A name that begins with a slash is returned unchanged."""
        return name if name.startswith("/") else f"{self.namespace}/{name}"

    def remote_setting(self, settings: Settings) -> str:
        return "" if settings.ros.localhost_only else "ros.localhost_only is false"


def ros_names(options: Ros2ControlOptions, limits: JointLimits) -> list[str]:
    """Return the arm's joint names in ROS, in the arm's order.

    Raises:
        ConfigError: the number of names is wrong, or a name occurs twice.
    """
    names = [options.prefix + name for name in options.joints or limits.names]
    if len(names) != limits.dof:
        raise ConfigError(
            f"robot.backend.joints has {len(names)} names, but the arm has {limits.dof} joints: "
            f"{', '.join(limits.names)}"
        )
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigError(f"robot.backend.joints: {twice[0]!r} occurs twice")
    return names


def client_settings(options: Ros2ControlOptions, settings: Settings, names: list[str]) -> dict[str, Any]:
    """Create the settings for the process that speaks DDS.

    Raises:
        ConfigError: the namespace is the same as for cobot's own topics.
    """
    own = f"/{settings.robot.name}"
    if options.namespace == own or (options.action or "").startswith(f"{own}/"):
        raise ConfigError(
            f"robot.backend: {own} is the namespace of cobot's own topics and actions: the robot would "
            "follow itself; choose another robot.name"
        )
    ros: RosSection = settings.ros
    network = ros.model_dump(mode="json", include={"domain_id", "interfaces", "localhost_only", "peers"})
    return {
        **network,
        "robot": settings.robot.name,
        "joints": names,
        "namespace": options.namespace,
        "controller": options.controller,
        "action": options.action,
        "controller_manager": options.below(options.controller_manager),
        "joint_states": options.below(options.joint_states),
        "speed_scaling": options.below(options.speed_scaling),
        "gpio": {
            "driver": options.io,
            "controller": options.io_names_begin,
            "interfaces": sorted({*options.inputs.values(), *options.outputs.values()}),
        },
        "answer_timeout_s": options.answer_timeout_s,
        "tolerances": {
            "path": options.path_tolerance_rad,
            "goal": options.goal_tolerance_rad,
            "time_s": options.goal_time_s,
        },
    }
