"""RuntimeMachine: programs, which are sequences and Lua files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.aubo.registry import CallOrigin, service

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "RuntimeMachine"


@service(CLASS)
async def load_program(robot: Services, program: str) -> None:
    """Check a program, and make it the one that runProgram runs.

    Args:
        program: its name in the folder that the setting sequences.programs names; ends in .json (a sequence)
            or .lua.
    """
    await robot.programs.load(program)


@service(CLASS)
async def run_program(robot: Services, origin: CallOrigin) -> None:
    """Run the loaded program once; answers when it has been started."""
    await robot.programs.run(origin.stops)


@service(CLASS)
async def start(robot: Services, origin: CallOrigin) -> None:
    """Run the loaded program once, as runProgram does."""
    await robot.programs.run(origin.stops)


@service(CLASS)
async def stop(robot: Services) -> None:
    """End the program and the motion, whosever they are; answers when the arm rests."""
    await robot.programs.stop()


@service(CLASS)
async def abort(robot: Services) -> None:
    """End the program and the motion, as stop does: it is as fast as the limits permit already."""
    await robot.programs.stop()


@service(CLASS)
async def pause(robot: Services) -> None:
    """Bring the arm to rest on its path; answers when it rests. The program waits with its next motion.

    Other work of a program continues. A pause of more than an hour ends the motion.
    """
    await robot.programs.pause()


@service(CLASS)
async def resume(robot: Services) -> None:
    """Go on with the motion and the program that were paused."""
    await robot.programs.resume()


@service(CLASS)
def get_runtime_state(robot: Services) -> str:
    """How the program stands.

    Returns:
        Running, Pausing, Paused, Stopping or Stopped.
    """
    return robot.programs.state


@service(CLASS)
def get_status(robot: Services) -> str:
    """How the program stands, as getRuntimeState says.

    Returns:
        Running, Pausing, Paused, Stopping or Stopped.
    """
    return robot.programs.state


@service(CLASS)
def get_loaded_program(robot: Services) -> str:
    """Which program is loaded.

    Returns:
        its name; empty for none.
    """
    return robot.programs.loaded


@service(CLASS)
def get_programs(robot: Services) -> list[str]:
    """Which programs there are.

    Returns:
        their names, sorted.
    """
    return robot.programs.names()


@service(CLASS)
def get_return_code(robot: Services) -> int:
    """How the last program ended.

    Returns:
        0 all done, 2 a mistake in the file, 3 a motion failed, 4 the robot was not available, 128 + N or -N
        ended by signal N; -1 when none has ended, or one runs.
    """
    code = robot.sequences.status.returncode
    return -1 if code is None else code


@service(CLASS)
def get_program_logs(robot: Services, number: int = 100) -> list[str]:
    """What programs have printed.

    Args:
        number: the maximum number of lines; 0 for 100.

    Returns:
        the newest lines, the oldest of them first.
    """
    return robot.sequences.lines(max(number, 1))
