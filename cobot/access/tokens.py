"""The file of access tokens, with their names, roles and hashes.

A token is 256 random bits, too many for a search by brute force. Its SHA-256 hash therefore needs neither a
salt nor a slow algorithm, and the file reveals no token. A token is shown once, when it is created.
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
from typing import Annotated

from pydantic import AwareDatetime, Field, TypeAdapter, ValidationError

from cobot.access.roles import ANONYMOUS, FLEET, ROS, SERVICE, Role, RoleName
from cobot.errors import ConfigError, ConflictError, InputError, NotFoundError
from cobot.strict import StrictModel, sentences, shown

PREFIX = "cobot_"
"""Prefix of each token, by which people and scanners for leaked secrets recognise it."""
RESERVED = (ANONYMOUS, ROS, FLEET, SERVICE.name)


Moment = Annotated[AwareDatetime, Field(strict=False)]
"""A time with a time zone. It is text in the file, because JSON has no type for times."""


class Token(StrictModel):
    """The record of one token, without the token itself.

    Attributes:
        sha256: hash of the token, hexadecimal.
        expires: time from which the token is invalid; None for never.
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
    """The hash of a token, which is all that the file contains of it."""
    return sha256(token.encode("utf-8", "surrogatepass")).hexdigest()


class TokenFile:
    """The file of all tokens. A missing file counts as an empty one.

    Every method raises:
        ConfigError: the file cannot be read or written, is invalid, or other users may change it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> Tokens:
        """Read all tokens."""
        try:
            # A pipe or a device at this path could block its reader forever.
            descriptor = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            with os.fdopen(descriptor, "rb") as file:
                status, content = os.fstat(descriptor), b""
                if stat.S_ISREG(status.st_mode):
                    content = file.read()
            if not stat.S_ISREG(status.st_mode):
                raise ConfigError(f"{self.path}: is not a regular file")
            trusted = (
                0,
                os.geteuid(),
                self.path.parent.stat().st_uid,
            )  # users who can replace the file in any case
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
        """Create a token and return it. The token itself is not stored.

        Raises:
            ConflictError: a token of this name exists.
            InputError: the name, the role or the lifetime is invalid.
        """
        token = PREFIX + secrets.token_urlsafe(32)
        now = datetime.now(UTC).replace(microsecond=0)
        if name in RESERVED:
            raise InputError(f"name: {shown(name)} is reserved for the service; choose another name")
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
        """Revoke a token.

        Raises:
            NotFoundError: no token has this name. The error lists the existing names.
        """

        def without(tokens: Tokens) -> Tokens:
            left = tuple(each for each in tokens if each.name != name)
            if len(left) == len(tokens):
                names = ", ".join(each.name for each in tokens) or "none"
                raise NotFoundError(f"there is no token {shown(name)}; there are: {names}")
            return left

        self._change(without)

    def _change(self, change: Callable[[Tokens], Tokens]) -> None:
        """Replace the file by a changed one, atomically: a reader gets either the old or the new content."""
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
                        if os.geteuid() == 0:  # a file made by root belongs to the folder's user
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
        """Lock the file against other processes that change it."""
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)
            yield
        finally:
            os.close(folder)
