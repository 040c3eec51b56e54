"""RuntimeMachine: programs, which are sequences and Lua files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.aubo.registry import CallOrigin, service

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "RuntimeMachine"


@service(CLASS)
async def load_program(robot: Services, program: str) -> None:
    """Check a program and load it, so that runProgram runs it.

    Args:
        program: name of the file in the folder sequences.programs of the settings; ends in .json (a sequence)
            or .lua.
    """
    await robot.programs.load(program)


@service(CLASS)
async def run_program(robot: Services, origin: CallOrigin) -> None:
    """Run the loaded program once. Returns when it has started."""
    await robot.programs.run(origin.stops)


@service(CLASS)
async def start(robot: Services, origin: CallOrigin) -> None:
    """Run the loaded program once, as runProgram does."""
    await robot.programs.run(origin.stops)


@service(CLASS)
async def stop(robot: Services) -> None:
    """End the program and the motion of any client. Returns when the arm is at rest."""
    await robot.programs.stop()


@service(CLASS)
async def abort(robot: Services) -> None:
    """End the program and the motion, as stop does. A stop is already as fast as the limits permit."""
    await robot.programs.stop()


@service(CLASS)
async def pause(robot: Services) -> None:
    """Pause: the arm stops on its path, and the program waits at its next motion. Returns when the arm is at
    rest.

    Other work of a program continues. A pause of more than an hour ends the motion.
    """
    await robot.programs.pause()


@service(CLASS)
async def resume(robot: Services) -> None:
    """Resume the paused motion and program."""
    await robot.programs.resume()


@service(CLASS)
def get_runtime_state(robot: Services) -> str:
    """The state of the program.

    Returns:
        Running, Pausing, Paused, Stopping or Stopped.
    """
    return robot.programs.state


@service(CLASS)
def get_status(robot: Services) -> str:
    """The state of the program, as in getRuntimeState.

    Returns:
        Running, Pausing, Paused, Stopping or Stopped.
    """
    return robot.programs.state


@service(CLASS)
def get_loaded_program(robot: Services) -> str:
    """The loaded program.

    Returns:
        the name; empty if none is loaded.
    """
    return robot.programs.loaded


@service(CLASS)
def get_programs(robot: Services) -> list[str]:
    """The available programs.

    Returns:
        their names, sorted.
    """
    return robot.programs.names()


@service(CLASS)
def get_return_code(robot: Services) -> int:
    """The result of the last program.

    Returns:
        0 success, 2 an error in the file, 3 a motion failed, 4 the robot was not available, 128 + N or -N
            ended by signal N; -1 if a program is running or none has ended yet.
    """
    code = robot.sequences.status.returncode
    return -1 if code is None else code


@service(CLASS)
def get_program_logs(robot: Services, number: int = 100) -> list[str]:
    """The output of programs.

    Args:
        number: maximum number of lines; 0 for 100.

    Returns:
        the newest lines, the oldest of them first.
    """
    return robot.sequences.lines(max(number, 1))
