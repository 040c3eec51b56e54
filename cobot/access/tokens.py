"""Access tokens, as they are kept: a file of their names, roles and hashes.

A token is 256 random bits. Nobody can try them all, so its SHA-256 needs neither salt nor slowness, and who
reads the file learns no token. It is shown once, when it is made.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
import stat
import tempfile
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AwareDatetime, Field, TypeAdapter, ValidationError

from cobot.access.roles import ANONYMOUS, ROS, SERVICE, Role
from cobot.errors import ConfigError, ConflictError, InputError, NotFoundError
from cobot.strict import StrictModel, sentences, shown

PREFIX = "cobot_"
"""Begins each token, so that people and scanners of leaked secrets know one when they see it."""
RESERVED = (ANONYMOUS, ROS, SERVICE.name)
RoleName = Literal["observer", "agent", "operator", "programmer", "admin"]


Moment = Annotated[AwareDatetime, Field(strict=False)]
"""JSON has no moments: in the file they are text."""


class Token(StrictModel):
    """One token, without itself.

    Attributes:
        sha256: hexadecimal.
        expires: None for never.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9._@-]{1,48}$")]
    role: RoleName
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    created: Moment
    expires: Moment | None = None

    @property
    def rights(self) -> Role:
        return Role[self.role.upper()]


Tokens = tuple[Token, ...]
_TOKENS = TypeAdapter(list[Token])


def hashed(token: str) -> str:
    """What is kept of a token."""
    return sha256(token.encode("utf-8", "surrogatepass")).hexdigest()


class TokenFile:
    """The tokens that there are. Without a file there are none.

    Every method raises:
        ConfigError: the file cannot be read or written, makes no sense, or others may change it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> Tokens:
        """All of them."""
        try:
            # What is no file may keep its reader waiting for ever: a pipe, a device.
            descriptor = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            with os.fdopen(descriptor, "rb") as file:
                status, content = os.fstat(descriptor), b""
                if stat.S_ISREG(status.st_mode):
                    content = file.read()
            if not stat.S_ISREG(status.st_mode):
                raise ConfigError(f"{self.path}: is no file")
            trusted = (
                0,
                os.geteuid(),
                self.path.parent.stat().st_uid,
            )  # who can put another one there anyway
            if status.st_mode & 0o022 or status.st_uid not in trusted:
                raise ConfigError(
                    f"{self.path}: others may change it, and with it who moves the robot: "
                    f"chown {os.geteuid()} and chmod 600 it"
                )
            return tuple(_TOKENS.validate_json(content))
        except FileNotFoundError:
            return ()
        except ValidationError as exc:
            raise ConfigError(f"{self.path}: {sentences(exc.errors())}") from exc
        except OSError as exc:
            raise ConfigError(f"{self.path}: cannot be read: {exc.strerror}") from exc

    def create(self, name: str, role: Role, lifetime: timedelta | None = None) -> str:
        """Make a token; what it returns is kept nowhere.

        Raises:
            ConflictError: there is one of this name.
            InputError: that is no name, or a role or lifetime that no token can have.
        """
        token = PREFIX + secrets.token_urlsafe(32)
        now = datetime.now(UTC).replace(microsecond=0)
        if name in RESERVED:
            raise InputError(f"name: {shown(name)} is what the service itself calls somebody")
        try:
            made = Token(
                name=name,
                role=role.name.lower(),  # type: ignore[arg-type]
                sha256=hashed(token),
                created=now,
                expires=now + lifetime if lifetime else None,
            )
        except (ValidationError, OverflowError) as exc:
            text = sentences(exc.errors()) if isinstance(exc, ValidationError) else "expires: too late"
            raise InputError(text) from exc

        def added(tokens: Tokens) -> Tokens:
            if any(each.name == name for each in tokens):
                raise ConflictError(f"there is a token {name!r} already; revoke it first")
            return (*tokens, made)

        self._change(added)
        return token

    def revoke(self, name: str) -> None:
        """Make a token worthless.

        Raises:
            NotFoundError: there is none of this name; lists those that there are.
        """

        def without(tokens: Tokens) -> Tokens:
            left = tuple(each for each in tokens if each.name != name)
            if len(left) == len(tokens):
                names = ", ".join(each.name for each in tokens) or "none"
                raise NotFoundError(f"there is no token {shown(name)}; there are: {names}")
            return left

        self._change(without)

    def _change(self, change: Callable[[Tokens], Tokens]) -> None:
        """Replace the file by a changed one at once: who reads it meanwhile gets the old or the new one."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with self._alone():
                content = _TOKENS.dump_json(list(change(self.read())), indent=1)
                descriptor, made = tempfile.mkstemp(dir=self.path.parent, prefix=".tokens-")  # 0600
                try:
                    with os.fdopen(descriptor, "wb") as file:
                        file.write(content)
                        file.flush()
                        os.fsync(descriptor)
                        if os.geteuid() == 0:  # root makes one for the user that the folder belongs to
                            owner = self.path.parent.stat()
                            os.fchown(descriptor, owner.st_uid, owner.st_gid)
                    os.replace(made, self.path)
                except BaseException:
                    os.unlink(made)
                    raise
        except OSError as exc:
            raise ConfigError(f"{self.path}: cannot be written: {exc.strerror}") from exc

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Of two that change it at a time, the second one waits."""
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)
            yield
        finally:
            os.close(folder)
