"""Bundles of programs, named positions and settings. A cell stages, activates and rolls back bundles.

A bundle is named by the SHA-256 of its content. The hub signs that name in its command, so the content can
come from anywhere. Everything that a bundle replaces is stored in a file before anything changes.
"""

from __future__ import annotations

import contextlib
import logging
import os
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, NoReturn, Protocol

import numpy as np
from pydantic import Field, ValidationError

from cobot.access.roles import Role
from cobot.client.rest import Client
from cobot.config import Settings, load_settings
from cobot.errors import (
    CobotError,
    ConflictError,
    InputError,
    NotFoundError,
    PermissionDenied,
    UnavailableError,
    exhausted,
)
from cobot.fleet.bundle import Bundle, BundlePosition, BundleProgram, hash_of, read_bundle
from cobot.fleet.cell_settings import CellSettings
from cobot.fleet.messages import NOT_ENDED, Hash, Text
from cobot.launch.process import RUN_MODULE
from cobot.robot.kept import keep, read_kept
from cobot.robot.limits import check_positions, load_joint_limits
from cobot.strict import StrictModel

CHECK_S = 30.0
SHORT = 8
"""Number of characters of a hash that are shown."""
log = logging.getLogger("cobot.fleet")


class Installed(StrictModel):
    """The latest bundle of a robot, and everything that it has replaced.

    Attributes:
        versions: versions of its programs in the service.
        programs_before, positions_before: programs and positions before; null for those that did not exist.
        settings_before: the bundle with the settings that were in force, "" without such a bundle; None if
            this bundle contains no settings.
        restart_for: changes of settings that need a cell restart. `supervisor` is the process id of that
            cell's supervisor.
        complete: whether the whole bundle is active. An interrupted activation is rolled back at the next
            start.
    """

    bundle: Hash
    title: Text
    versions: dict[str, int]
    programs_before: dict[str, BundleProgram | None]
    positions_before: dict[str, BundlePosition | None]
    settings_before: Hash | Literal[""] | None = None
    restart_for: list[Text] = Field(default_factory=list)
    supervisor: int = 0
    complete: bool


class PendingRestart(StrictModel):
    """Changes of settings that need a cell restart after the rollback of a bundle.

    Attributes:
        title: name and version of that bundle.
        supervisor: process id of the supervisor that has not been restarted yet.
    """

    title: Text
    changes: list[Text]
    supervisor: int


class BundlesCell(Protocol):
    """The part of a cell that its bundles use.

    Attributes:
        config: the settings file that is in force. A reload replaces it.
        source: the user's settings file.
    """

    config: Path
    source: Path

    def fetch_bundle(self, name: str) -> bytes | None:
        """The bundle content; None if the hub does not have it."""


class RobotBundles:
    """The bundles of one robot of a cell. Only one method may run at a time.

    Args:
        settings: the robot's settings.
    """

    def __init__(self, settings: Settings, client: Client, cell: BundlesCell) -> None:
        self._settings, self._client, self._cell = settings, client, cell
        self._own = CellSettings(settings, cell.source, client)
        self._file = settings.bundle_file
        self._staged: dict[str, Bundle] = {}
        self.installed = self._read()
        self._pending = self._read_pending()

    @property
    def title(self) -> str:
        """Name, version and hash of the latest bundle; "" before the first bundle."""
        found = self.installed
        return f"{found.title} ({found.bundle[:SHORT]})" if found is not None and found.complete else ""

    @property
    def restart(self) -> str:
        """The settings that a roll-out or a rollback has changed and that need a restart of this cell, as
        text; "" if no setting needs a restart.
        """
        found, pending = self.installed, self._pending  # another thread may replace them
        texts = []
        if found is not None and found.restart_for and found.supervisor == os.getppid():
            texts.append(f"{found.title} needs a restart of this cell: {'; '.join(found.restart_for)}")
        if pending is not None and pending.supervisor == os.getppid():
            changes = "; ".join(pending.changes)
            texts.append(f"the rollback of {pending.title} needs a restart of this cell: {changes}")
        return "; ".join(texts)

    def drift(self, versions: dict[str, int]) -> list[str]:
        """The parts of the latest bundle that have changed since its activation: ids of programs, and
        "settings".

        Args:
            versions: the latest version of each stored program.
        """
        found = self.installed  # another thread may replace it
        if found is None or not found.complete:
            return []
        changed = sorted(name for name, version in found.versions.items() if versions.get(name) != version)
        other = found.settings_before is not None and self._own.active != found.bundle
        return [*changed, *(["settings"] if other else [])]

    def stage(self, name: str, role: Role) -> str:
        """Fetch a bundle and check it completely. This changes nothing in the cell.

        Args:
            role: role that the person has at the hub.

        Raises:
            UnavailableError: the hub does not have the bundle.
            PermissionDenied: the bundle contains settings, and this role may not change them.
            InputError: the content does not match the name, is invalid, or is not suitable for this robot.
        """
        content = self._cell.fetch_bundle(name)
        if content is None:
            raise UnavailableError(f"the hub does not have the bundle {name[:SHORT]}; send it again")
        if hash_of(content) != name:
            raise InputError(
                f"the content does not belong to the bundle {name[:SHORT]}: its hash differs; send the "
                "bundle again"
            )
        bundle = read_bundle(content)
        self._require_accepted(bundle.title, bool(bundle.settings), role)
        try:
            if bundle.settings:
                with self._own.trial(bundle.settings) as settings:
                    self._check(bundle, settings)
            else:
                self._check(bundle, load_settings(self._cell.config).of(self._settings.robot.name))
        except OSError as exc:  # about the files that are created for the checks
            raise exhausted(exc) or UnavailableError(f"the bundle cannot be checked: {exc}") from exc
        self._staged = {name: bundle}
        parts = f"{len(bundle.programs)} programs, {len(bundle.positions)} positions"
        return f"staged {bundle.title}: {parts}{', settings' if bundle.settings else ''}"

    def _require_accepted(self, title: str, has_settings: bool, role: Role) -> None:
        needed = self._settings.fleet.accept.settings
        if has_settings and (needed == "none" or role < Role[needed.upper()]):
            raise PermissionDenied(
                f"{title} contains settings; this cell accepts settings from {needed} "
                f"(fleet.accept.settings), but the role is {role.name.lower()}"
            )

    def activate(self, name: str, role: Role) -> str:
        """Activate the staged bundle while the arm does not move. If this fails, everything is restored.

        Args:
            role: role that the person has at the hub.

        Raises:
            ConflictError: the bundle is not staged, or a job is running.
            PermissionDenied: see `stage`.
            CobotError: the service rejects part of the bundle; the message names the part.
        """
        bundle = self._staged.get(name)
        if bundle is None:
            raise ConflictError(f"the bundle {name[:SHORT]} is not staged here; stage it first")
        self._require_accepted(bundle.title, bool(bundle.settings), role)
        if self._is_active(name):
            return f"{bundle.title} is active already"
        self._require_rest()
        self.recover()  # otherwise an interrupted activation would be stored as the earlier state
        previous = self.installed
        self._keep(self._before(name, bundle))
        restart_for: list[str] = []
        try:
            if bundle.settings:
                restart_for = self._own.activate(name, bundle.settings)
                self._keep_pending("", [])  # `restart_for` lists all differences from the running cell
        except (ConflictError, InputError) as exc:
            self._keep(previous)
            raise type(exc)(f"{exc}; nothing has changed") from exc
        except CobotError as exc:
            self._undo_after(exc)
        try:
            versions = {each.id: self._save(each, bundle.title) for each in bundle.programs}
            for position in bundle.positions:
                self._teach(position)
        except CobotError as exc:
            self._undo_after(exc)
        assert self.installed is not None
        done = {
            "versions": versions,
            "restart_for": restart_for,
            "supervisor": os.getppid(),
            "complete": True,
        }
        self._keep(self.installed.model_copy(update=done))
        self._staged = {}
        self._own.remove_others(name, self.installed.settings_before or name)
        return f"activated {bundle.title}{_restart(restart_for)}"

    def _is_active(self, name: str) -> bool:
        if self.installed is None or self.installed.bundle != name or not self.installed.complete:
            return False
        return not self.drift({each["id"]: each["version"] for each in self._client.programs()})

    def roll_back(self, name: str, role: Role) -> str:
        """Restore what a bundle has replaced.

        Args:
            role: role that the person has at the hub.

        Raises:
            NotFoundError: the bundle is not the latest one.
            PermissionDenied: see `stage`.
            ConflictError: a job is running.
        """
        if self.installed is None or self.installed.bundle != name:
            raise NotFoundError(f"the bundle {name[:SHORT]} is not the latest one here; nothing was changed")
        title = self.installed.title
        self._require_accepted(title, self.installed.settings_before is not None, role)
        self._require_rest()
        return f"rolled back {title}{_restart(self._undo())}"

    def recover(self) -> None:
        """Roll back an activation that was interrupted.

        Raises:
            CobotError: the service does not answer yet, or a job is running.
        """
        if self.installed is not None and not self.installed.complete:
            self._require_rest()
            changes = self._undo()
            log.warning("an activation was interrupted; its changes have been undone%s", _restart(changes))

    def _check(self, bundle: Bundle, settings: Settings) -> None:
        """Check programs and positions with the given settings: those of this cell or those of the bundle."""
        limits = load_joint_limits(settings.web.joint_limits)
        fixed = {each["name"] for each in self._client.positions() if not each["taught"]}
        for position in bundle.positions:
            if position.name in fixed:
                raise InputError(
                    f"position {position.name}: is part of the robot's SRDF; choose another name"
                )
            if len(position.joints) != len(limits.names):
                raise InputError(
                    f"position {position.name}: has {len(position.joints)} joints, but this robot has "
                    f"{len(limits.names)}"
                )
            check_positions(limits, np.array(position.joints), f"position {position.name}: joint angle")
        with TemporaryDirectory(prefix="cobot-bundle-") as folder:
            for program in bundle.programs:
                file = Path(folder) / f"{program.id}.{'lua' if program.kind == 'lua' else 'json'}"
                file.write_text(program.text, encoding="utf-8")
            for file in sorted(Path(folder).iterdir()):
                self._check_program(file)

    @staticmethod
    def _check_program(file: Path) -> None:
        command = [*RUN_MODULE, "cobot.runner", "check", str(file)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=CHECK_S, check=False)
        except subprocess.TimeoutExpired as exc:
            raise InputError(f"program {file.stem}: could not be checked within {CHECK_S:g} s") from exc
        if done.returncode:
            said = (done.stderr or done.stdout).strip().replace(f"{file.parent}/", "")
            raise InputError(f"program {file.stem}: {said[:1000]}")

    def _require_rest(self) -> None:
        running = self._client.jobs(1, *NOT_ENDED)
        if running:
            raise ConflictError(f"{running[0]['request']} has not ended; the arm must be at rest")

    def _before(self, name: str, bundle: Bundle) -> Installed:
        programs: dict[str, BundleProgram | None] = {}
        for program in bundle.programs:
            try:
                old = self._client.program(program.id)
            except NotFoundError:
                programs[program.id] = None
            else:
                programs[program.id] = BundleProgram.model_validate(
                    {field: old[field] for field in BundleProgram.model_fields}
                )
        known = {each["name"]: each for each in self._client.positions()}
        fields = list(BundlePosition.model_fields)
        positions = {
            each.name: BundlePosition.model_validate({field: known[each.name][field] for field in fields})
            if each.name in known
            else None
            for each in bundle.positions
        }
        return Installed(
            bundle=name,
            title=bundle.title,
            versions={},
            programs_before=programs,
            positions_before=positions,
            settings_before=self._own.active if bundle.settings else None,
            complete=False,
        )

    def _save(self, program: BundleProgram, note: str) -> int:
        try:
            base = int(self._client.program(program.id)["version"])
        except NotFoundError:
            base = None
        saved = self._client.save_program(
            program.id, program.label, program.text, kind=program.kind, note=note, base=base
        )
        return int(saved["version"])

    def _restore(self, program: BundleProgram, note: str) -> None:
        """Save the earlier program again, unless an interrupted rollback has already saved it."""
        with contextlib.suppress(NotFoundError):
            newest = self._client.program(program.id)
            if all(newest[field] == value for field, value in program.model_dump().items()):
                return
        self._save(program, note)

    def _teach(self, position: BundlePosition) -> None:
        self._client.teach_position(
            position.name, position.joints, position.description, label=position.label
        )

    def _undo_after(self, exc: CobotError) -> NoReturn:
        """Restore everything after an error.

        Raises:
            CobotError: the same error. Its message also reports whether everything was restored.
        """
        try:
            self._undo()
        except CobotError as problem:
            raise type(exc)(f"{exc}; the change cannot be undone now ({problem}); cobot tries again") from exc
        raise type(exc)(f"{exc}; everything is as before") from exc

    def _undo(self) -> list[str]:
        """Restore what the installed bundle changed. Returns the changes of settings that need a restart of
        the cell.
        """
        assert self.installed is not None
        before = self.installed.settings_before
        restart_for: list[str] = []
        if before is not None:
            restart_for = self._own.switch(before)
            self._keep_pending(self.installed.title, restart_for)
        for name, program in self.installed.programs_before.items():
            if program is not None:
                self._restore(program, f"before {self.installed.title}")
            else:
                with contextlib.suppress(NotFoundError):
                    self._client.delete_program(name)
        for name, position in self.installed.positions_before.items():
            if position is not None:
                self._teach(position)
            else:
                with contextlib.suppress(NotFoundError):
                    self._client.forget_position(name)
        self._keep(None)
        return restart_for

    def _keep(self, installed: Installed | None) -> None:
        if installed is None:
            self._file.unlink(missing_ok=True)
        else:
            keep(self._file, installed.model_dump_json().encode(), "the bundle")
        self.installed = installed

    def _keep_pending(self, title: str, changes: list[str]) -> None:
        file = self._settings.restart_file
        if changes:
            self._pending = PendingRestart(title=title, changes=changes, supervisor=os.getppid())
            keep(file, self._pending.model_dump_json().encode(), "the list of changes")
        else:
            self._pending = None
            file.unlink(missing_ok=True)

    def _read_pending(self) -> PendingRestart | None:
        with contextlib.suppress(OSError, ValidationError):  # only a hint for people
            return PendingRestart.model_validate_json(read_kept(self._settings.restart_file))
        return None

    def _read(self) -> Installed | None:
        try:
            return Installed.model_validate_json(read_kept(self._file))
        except FileNotFoundError:
            return None
        except (OSError, ValidationError) as exc:
            log.error("%s: cannot be read, so its bundle cannot be rolled back: %s", self._file, exc)
            return None


def _restart(changes: list[str]) -> str:
    return f"; restart the cell for: {'; '.join(changes)}" if changes else ""
