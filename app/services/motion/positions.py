"""Named positions: those of the SRDF, which never change here, and those that people have taught."""

from __future__ import annotations

import asyncio
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from app.services.motion.goals import Goals
from app.services.state.link import RobotLink
from cobot.errors import ConfigError, ConflictError, NotFoundError
from cobot.robot.description import RobotDescription
from cobot.robot.kept import keep
from cobot.strict import sentences, shown
from cobot.types import NamedPosition, Scaling

MAX_TAUGHT = 200
TAUGHT = "taught"
"""The group of a position that is in no SRDF."""
STATE_TIMEOUT_S = 1.5
_FILE = TypeAdapter(dict[str, NamedPosition])


class PositionService:
    """The positions of one robot.

    Args:
        file: where those that were taught are kept.

    Raises:
        ConfigError: that file cannot be read, or has something else in it.
    """

    def __init__(self, robot: RobotDescription, link: RobotLink, goals: Goals, file: Path) -> None:
        self._robot = robot
        self._link = link
        self._goals = goals
        self._file = file
        self._turn = asyncio.Lock()
        goals.taught = self._read()

    def all(self) -> list[NamedPosition]:
        """Those of the SRDF first. One that has come into it since it was taught is that of the SRDF."""
        own = self._robot.positions
        taught = [each for name, each in self._goals.taught.items() if name not in own]
        return [*own.values(), *taught]

    async def teach(self, name: str, joints: list[float] | None, description: str) -> NamedPosition:
        """Give a place a name, or a name another place; it is on the disk when this returns.

        Args:
            joints: rad; None for where the arm is.

        Raises:
            InputError, LimitError: no possible joints.
            ConflictError: the name is the SRDF's, or there are too many already.
            UnavailableError: the arm's joints are not known, or the disk takes nothing.
        """
        if name in self._robot.positions:
            raise ConflictError(f"name: {shown(name)} is a position of the SRDF; take another name")
        if joints is None:
            state = await self._link.measured_state(STATE_TIMEOUT_S)
            joints = state.commanded_position.tolist()
        self._goals.joints(joints, Scaling(1.0))
        async with self._turn:
            taught = dict(self._goals.taught)
            if name not in taught and len(taught) >= MAX_TAUGHT:
                raise ConflictError(f"{MAX_TAUGHT} positions are taught already; remove one")
            made = taught[name] = NamedPosition(name, TAUGHT, tuple(joints), description)
            await self._keep(taught)
        return made

    async def forget(self, name: str) -> None:
        """Remove one that was taught.

        Raises:
            NotFoundError: there is none of this name.
            UnavailableError: the disk takes nothing.
        """
        async with self._turn:
            taught = dict(self._goals.taught)
            if taught.pop(name, None) is None:
                raise NotFoundError(f"no position {shown(name)} was taught; GET /robot/positions lists them")
            await self._keep(taught)

    async def _keep(self, taught: dict[str, NamedPosition]) -> None:
        content = _FILE.dump_json(taught, indent=1)
        await asyncio.to_thread(keep, self._file, content, "the taught positions")
        self._goals.taught = taught

    def _read(self) -> dict[str, NamedPosition]:
        try:
            return _FILE.validate_json(self._file.read_bytes())
        except FileNotFoundError:
            return {}
        except ValidationError as exc:
            raise ConfigError(f"{self._file}: has no positions: {sentences(exc.errors())}") from exc
        except OSError as exc:
            raise ConfigError(f"{self._file}: cannot be read: {exc.strerror}") from exc
