"""Named positions: those from the SRDF, which never change, and taught ones."""

from __future__ import annotations

import asyncio
import logging
import math
from itertools import count, islice
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter, ValidationError

from app.services.motion.goals import Goals
from app.services.state.link import RobotLink
from cobot.errors import CobotError, ConflictError, NotFoundError
from cobot.robot.description import RobotDescription
from cobot.robot.kept import keep, read_kept
from cobot.strict import sentences, shown
from cobot.types import NamedPosition

MAX_TAUGHT = 200
TAUGHT = "taught"
"""Group name of positions that are not in the SRDF."""
STATE_TIMEOUT_S = 1.5
SPOILT = ".spoilt-"
_FILE = TypeAdapter(dict[str, NamedPosition])

log = logging.getLogger("cobot.positions")


class PositionService:
    """The positions of one robot.

    Args:
        file: file with the taught positions.
    """

    def __init__(self, robot: RobotDescription, link: RobotLink, goals: Goals, file: Path) -> None:
        self._robot = robot
        self._link = link
        self._goals = goals
        self._file = file
        self._turn = asyncio.Lock()
        self._problem = ""
        self._aside: Path | None = None
        goals.taught = self._read()
        self._set_aside_before()

    @property
    def problem(self) -> str:
        """Describe the problem with the file; "" if there is none. The problem lasts as long as a damaged
        file that was set aside exists.
        """
        return self._problem if self._aside is not None and self._aside.exists() else ""

    def all(self) -> list[NamedPosition]:
        """List all positions, those from the SRDF first. SRDF positions take precedence over taught positions
        with the same name.
        """
        own = self._robot.positions
        taught = [each for name, each in self._goals.taught.items() if name not in own]
        return [*own.values(), *taught]

    async def teach(
        self, name: str, joints: list[float] | None, description: str, label: str = ""
    ) -> NamedPosition:
        """Store a position under a new or an existing name. Returns once it has been written to disk.

        Args:
            joints: joint positions, rad; None for the arm's current position.

        Raises:
            InputError, LimitError: the joint positions are invalid.
            ConflictError: the SRDF contains a position with this name, or there are too many positions.
            UnavailableError: the arm's joint positions are unknown, or the file cannot be written.
        """
        if name in self._robot.positions:
            raise ConflictError(
                f"name: {shown(name)} is a position of the SRDF; choose another name",
                details={"cause": "name_taken"},
            )
        if joints is None:
            state = await self._link.await_measured_state(STATE_TIMEOUT_S)
            joints = state.commanded_position.tolist()
        self._goals.require_joints(np.array(joints))
        async with self._turn:
            taught = dict(self._goals.taught)
            if name not in taught and len(taught) >= MAX_TAUGHT:
                raise ConflictError(
                    f"there are already {MAX_TAUGHT} taught positions, which is the maximum; remove one",
                    details={"cause": "full"},
                )
            made = taught[name] = NamedPosition(name, TAUGHT, tuple(joints), description, label)
            await self._keep(taught)
        self._link.events.publish("positions", what="taught", name=name, label=label or name)
        return made

    async def forget(self, name: str) -> None:
        """Delete a taught position.

        Raises:
            NotFoundError: there is no taught position with this name.
            UnavailableError: the file cannot be written.
        """
        async with self._turn:
            taught = dict(self._goals.taught)
            gone = taught.pop(name, None)
            if gone is None:
                raise NotFoundError(f"no position {shown(name)} was taught; GET /robot/positions lists them")
            await self._keep(taught)
        self._link.events.publish("positions", what="forgotten", name=name, label=gone.label or name)

    async def _keep(self, taught: dict[str, NamedPosition]) -> None:
        content = _FILE.dump_json(taught, indent=1)
        await asyncio.to_thread(keep, self._file, content, "the taught positions")
        self._goals.taught = taught

    def _read(self) -> dict[str, NamedPosition]:
        """Read the file. A damaged file is set aside, and its valid positions are written to a new file.

        The arm can be moved without the file, so a damaged file does not prevent the service from starting.
        """
        try:
            found = _FILE.validate_json(read_kept(self._file))
        except FileNotFoundError:
            return {}
        except ValidationError as exc:
            self._set_aside(sentences(exc.errors()))
            return {}
        except OSError as exc:
            self._set_aside(f"cannot be read: {exc.strerror}")
            return {}
        flaws = {name: flaw for name, each in found.items() if (flaw := self._flaw(name, each))}
        if not flaws:
            return found
        self._set_aside("; ".join(f"{shown(name)} {flaw}" for name, flaw in islice(flaws.items(), 3)))
        good = {name: each for name, each in found.items() if name not in flaws}
        try:
            keep(self._file, _FILE.dump_json(good, indent=1), "the taught positions")
        except CobotError as exc:
            self._problem += f"; {exc}"
        return good

    def _flaw(self, name: str, position: NamedPosition) -> str:
        dof = self._robot.limits.dof
        if len(position.joints) != dof:
            return f"has {len(position.joints)} joints, but this arm has {dof}"
        if not all(map(math.isfinite, position.joints)):
            return f"has joints that are not numbers: {shown(position.joints)}"
        return "" if position.name == name else f"contains the different name {shown(position.name)}"

    def _set_aside(self, why: str) -> None:
        aside = next(
            file
            for number in count(1)
            if not (file := self._file.with_name(f"{self._file.name}{SPOILT}{number}")).exists()
        )
        self._problem = f"taught positions: {self._file}: {why}"
        try:
            self._file.rename(aside)
            self._problem += f"; it was set aside as {aside.name}: check that file, then remove it"
            self._aside = aside
        except OSError as exc:
            self._problem += f"; it cannot be set aside: {exc.strerror}"
            self._aside = self._file
        log.error("%s", self._problem)

    def _set_aside_before(self) -> None:
        """After a restart, report again that a damaged file was set aside."""
        found = sorted(self._file.parent.glob(f"{self._file.name}{SPOILT}*"))
        if found and self._aside is None:
            self._aside = found[-1]
            self._problem = (
                f"taught positions: {self._aside} was set aside because it could not be read; the log "
                "of that start contains the reason; check that file, then remove it"
            )
