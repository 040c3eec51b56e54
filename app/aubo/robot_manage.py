"""RobotManage: power, faults, modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.aubo.registry import service
from cobot.errors import NotSupportedError
from cobot.types import LoopMode

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "RobotManage"
STATE_TIMEOUT_S = 1.5
RESET_TIMEOUT_S = 10.0
NO_BRAKES = "the drives are on while the real-time process runs; end `cobot run` to switch them off"
RECORDINGS = "recordings are made by sequences, see bag_path of POST /sequences/start"


@service(CLASS)
async def poweron(robot: Services) -> None:
    """Check that the drives are on. They are on while the real-time process is running without a fault."""
    await robot.link.await_ready_state(STATE_TIMEOUT_S)


@service(CLASS)
async def startup(robot: Services) -> None:
    """Check that the arm is ready to move, as poweron does."""
    await robot.link.await_ready_state(STATE_TIMEOUT_S)


@service(CLASS)
async def release_robot_brake(robot: Services) -> None:
    """Check, as poweron does, that the drives hold the arm and not the brakes."""
    await robot.link.await_ready_state(STATE_TIMEOUT_S)


@service(CLASS)
async def poweroff(robot: Services) -> None:
    """Not supported: the drives are on while the real-time process runs."""
    del robot
    raise NotSupportedError(NO_BRAKES)


@service(CLASS)
async def lock_robot_brake(robot: Services) -> None:
    """Not supported, because the drives are on while the real-time process is running."""
    del robot
    raise NotSupportedError(NO_BRAKES)


@service(CLASS)
async def set_unlock_protective_stop(robot: Services) -> None:
    """Leave an e-stop, a protective stop or a fault once its cause has been removed. Nothing moves."""
    await robot.stopping.reset(RESET_TIMEOUT_S)


@service(CLASS)
def backdrive(robot: Services, enable: bool) -> None:
    """Not supported: the arm cannot be moved against its brakes.

    Args:
        enable: whether to enable it.
    """
    del robot, enable
    raise NotSupportedError(
        "the arm cannot be pushed against brakes; stream joint torques to move it by hand"
    )


@service(CLASS)
def freedrive(robot: Services, enable: bool) -> None:
    """Not supported here. To move the arm by hand, stream joint torques of 0.

    Args:
        enable: whether to let the arm be moved by hand.
    """
    del robot
    if enable:
        raise NotSupportedError("stream joint torques of 0 instead: then the arm can be moved by hand")


@service(CLASS)
def is_freedrive_enabled(robot: Services) -> bool:
    """Whether freedrive is on.

    Returns:
        always false: freedrive is not supported here.
    """
    del robot
    return False


@service(CLASS)
def is_backdrive_enabled(robot: Services) -> bool:
    """Whether the arm can be pushed against its brakes.

    Returns:
        always false: this is not supported.
    """
    del robot
    return False


@service(CLASS)
async def get_robot_control_mode(robot: Services) -> str:
    """The mode of the real-time process.

    Returns:
        HOLD, TRAJECTORY, STOPPING, JOINT_IMPEDANCE, CARTESIAN, JOINT_TORQUE, ESTOP or FAULT.
    """
    return (await robot.link.await_fresh_state(STATE_TIMEOUT_S)).mode.name


@service(CLASS)
async def get_operational_mode(robot: Services) -> str:
    """The operational mode.

    Returns:
        Automatic, because there is no teach pendant; Disabled after an e-stop or a fault.
    """
    mode = (await robot.link.await_fresh_state(STATE_TIMEOUT_S)).mode
    return "Disabled" if mode in (LoopMode.ESTOP, LoopMode.FAULT) else "Automatic"


@service(CLASS)
def set_operational_mode(robot: Services, mode: str) -> None:
    """Not supported: the only mode is Automatic.

    Args:
        mode: name of the mode.
    """
    del robot
    if mode != "Automatic":
        raise NotSupportedError(
            f"there is no operational mode {mode!r}; the only one is Automatic, because there is no teach "
            f"pendant"
        )


@service(CLASS)
def is_simulation_enabled(robot: Services) -> bool:
    """Whether the arm is simulated.

    Returns:
        true if robot.backend is mujoco.
    """
    return robot.equipment.simulated


@service(CLASS)
def set_sim(robot: Services, enable: bool) -> None:
    """Accepts only the current state; a change is not supported. The setting robot.backend decides whether
    the arm is simulated.

    Args:
        enable: whether to simulate the arm.
    """
    if enable != robot.equipment.simulated:
        raise NotSupportedError(
            "the setting robot.backend decides whether the arm is simulated, at the start"
        )


@service(CLASS)
def start_record(robot: Services, file: str) -> None:
    """Not supported: sequences make recordings.

    Args:
        file: file name.
    """
    del robot, file
    raise NotSupportedError(RECORDINGS)


@service(CLASS)
def stop_record(robot: Services) -> None:
    """Not supported: sequences make recordings."""
    del robot
    raise NotSupportedError(RECORDINGS)
