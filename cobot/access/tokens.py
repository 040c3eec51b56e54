"""The file of access tokens, with their names, roles and hashes.

A token consists of 256 random bits, which are too many for a brute-force search. Its SHA-256 hash therefore
needs neither a salt nor a slow algorithm, and the file reveals no token. A token is shown once, when it is
created.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from pathlib import Path
from typing import Annotated

from pydantic import AwareDatetime, Field, TypeAdapter, ValidationError

from cobot.access.roles import ANONYMOUS, FLEET, ROS, SERVICE, Role, RoleName
from cobot.errors import (
    ConfigError,
    ConflictError,
    InputError,
    NotFoundError,
    PermissionDenied,
    UnavailableError,
)
from cobot.strict import StrictModel, sentences, shown

PREFIX = "cobot_"
"""Prefix of each token, so that people and scanners for leaked secrets recognise it."""
RESERVED = (ANONYMOUS, ROS, FLEET, SERVICE.name)
NOT_IN_PATHS = (".", "..")
"""Names that no client can send as a part of a URL. A token with such a name could not be deleted."""
MAX_TOKENS = 256
"""Maximum number of tokens, because each request is compared with all of them, which takes 0.2 µs per
token.
"""
MAX_DAYS = 36_500
"""Maximum lifetime in days: a hundred years, so that the date is before the end of the calendar in 9999."""
MIN_LIFETIME = timedelta(minutes=1)
"""Minimum lifetime, because a user must receive the token before it expires."""
MAX_LISTED = 20
"""Maximum number of names in an error."""
LOCKED_S, LOOK_S = 5.0, 0.01
"""Time to wait for another program that is changing the file, and time between two attempts, in seconds.
"""
NAME = r"^[A-Za-z0-9._@-]{1,48}$"
"""Form of a token's name."""
_LEFT = ".tokens-"

Moment = Annotated[AwareDatetime, Field(strict=False)]
"""A time with a time zone. It is text in the file, because JSON has no type for times."""


class Token(StrictModel):
    """The record of one token, without the token itself.

    Attributes:
        sha256: hash of the token, hexadecimal.
        expires: time from which the token is invalid; None if it never expires.
    """

    name: Annotated[str, Field(pattern=NAME)]
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
    """The hash of a token. The file contains the hash and never the token."""
    return sha256(token.encode("utf-8", "surrogatepass")).hexdigest()


class TokenFile:
    """The file of all tokens. A missing file is treated as empty.

    Every method raises:
        ConfigError: the file cannot be read or written, is invalid, or may be changed by other users.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> Tokens:
        """Read all tokens."""
        try:
            # If a pipe or a device is at this path, reading it could block forever.
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
            )  # users who can replace the file anyway
            if status.st_mode & 0o022 or status.st_uid not in trusted:
                raise ConfigError(
                    f"{self.path}: other users may change this file, and so control the robot: "
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
        """Create a token with `create_entry`, and return the token."""
        return self.create_entry(name, role, lifetime)[1]

    def create_entry(
        self, name: str, role: Role, lifetime: timedelta | None = None, *, by: str | None = None
    ) -> tuple[Token, str]:
        """Create a token and return its record and the token itself, which is not stored.

        Args:
            by: name of the token of the administrator who requests the new token; None for the command `cobot
                token`, which needs no token.

        Raises:
            ConflictError: a token with this name exists, or there are already `MAX_TOKENS` tokens.
            InputError: the name, the role or the lifetime is invalid.
            PermissionDenied: `by` is no longer the name of an administrator's token.
        """
        token = PREFIX + secrets.token_urlsafe(32)
        now = datetime.now(UTC).replace(microsecond=0)
        if name in RESERVED:
            raise InputError(f"name: {shown(name)} is reserved for the service; choose another name")
        if name in NOT_IN_PATHS:
            raise InputError(f"name: {shown(name)} cannot be part of a URL; choose another name")
        if lifetime is not None and lifetime < MIN_LIFETIME:
            raise InputError(
                f"the lifetime is {lifetime.total_seconds():g} s, allowed: "
                f"{MIN_LIFETIME.total_seconds():g} s or more; without a lifetime, the token never expires"
            )
        try:
            made = Token(
                name=name,
                role=role.name.lower(),  # type: ignore[arg-type]
                sha256=hashed(token),
                created=now,
                expires=None if lifetime is None else now + lifetime,
            )
        except (ValidationError, OverflowError) as exc:
            text = (
                sentences(exc.errors())
                if isinstance(exc, ValidationError)
                else "expires: the time is after the year 9999; give a shorter lifetime, or none"
            )
            raise InputError(text) from exc

        def added(tokens: Tokens) -> Tokens:
            _require_admin(tokens, by)
            if any(each.name == name for each in tokens):
                raise ConflictError(
                    f"token {name!r} already exists; revoke it first", details={"cause": "name_taken"}
                )
            if len(tokens) >= MAX_TOKENS:
                raise ConflictError(
                    f"there are {len(tokens)} tokens, allowed: {MAX_TOKENS}; revoke one that is not used",
                    details={"cause": "full"},
                )
            return (*tokens, made)

        self._change(added)
        return made, token

    def revoke(self, name: str, *, by: str | None = None, own: bool = False) -> Token:
        """Revoke a token, and return its record.

        Args:
            by: see `create_entry`. If a name is given, the last token of an administrator is not revoked.
            own: whether the client may revoke its own token, `by`.

        Raises:
            NotFoundError: no token has this name. The error lists the names that exist.
            ConflictError: the token is the last one of an administrator, or the client's own.
            PermissionDenied: `by` is no longer the name of an administrator's token.
        """
        revoked: list[Token] = []

        def without(tokens: Tokens) -> Tokens:
            _require_admin(tokens, by)
            left = tuple(each for each in tokens if each.name != name)
            if len(left) == len(tokens):
                raise NotFoundError(f"there is no token {shown(name)}; valid names: {_names(tokens)}")
            if by is not None and not _admins(left):
                raise ConflictError(
                    f"{name} is the last token of an administrator; create another one first, or revoke it "
                    f"on the robot's computer: cobot token revoke {name}"
                )
            if by == name and not own:
                raise ConflictError(
                    f"{name} is the token that this request itself uses; use the token of "
                    "another administrator, or confirm it with own=true"
                )
            revoked.extend(each for each in tokens if each.name == name)
            return left

        self._change(without)
        return revoked[0]

    def _change(self, change: Callable[[Tokens], Tokens]) -> None:
        """Replace the file with a changed one, atomically. A reader gets either the old or the new
        content.
        """
        try:
            path = Path(os.path.realpath(self.path))  # replace the link's target, not the link
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with _hold_lock(path) as folder:
                for left in path.parent.glob(f"{_LEFT}*"):  # Remove the temporary files of killed programs.
                    left.unlink()
                content = _TOKENS.dump_json(list(change(self.read())), indent=1)
                descriptor, made = tempfile.mkstemp(dir=path.parent, prefix=_LEFT)  # with mode 0600
                try:
                    with os.fdopen(descriptor, "wb") as file:
                        file.write(content)
                        file.flush()
                        os.fsync(descriptor)
                        if os.geteuid() == 0:  # a file that root has made must belong to the folder's user
                            owner = path.parent.stat()
                            os.fchown(descriptor, owner.st_uid, owner.st_gid)
                    os.replace(made, path)
                except BaseException:
                    os.unlink(made)
                    raise
                os.fsync(folder)  # a power cut must not bring back a revoked token
        except OSError as exc:
            raise ConfigError(f"{self.path}: cannot be written: {exc.strerror}") from exc


@contextlib.contextmanager
def _hold_lock(path: Path) -> Iterator[int]:
    """Lock a file against changes by other processes. Yields the descriptor of its folder."""
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        _lock(folder, path)
        yield folder
    finally:
        os.close(folder)


def _lock(folder: int, path: Path) -> None:
    """Lock a folder.

    Raises:
        UnavailableError: another program has kept the folder locked for `LOCKED_S`.
    """
    ends_s = time.monotonic() + LOCKED_S
    while True:
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > ends_s:
                raise UnavailableError(
                    f"{path}: another program has been changing it for {LOCKED_S:g} s; end that program"
                ) from None
            time.sleep(LOOK_S)
        else:
            return


def _admins(tokens: Tokens) -> list[Token]:
    """The tokens of administrators that have not expired."""
    now = datetime.now(UTC)
    return [
        each for each in tokens if each.rights is Role.ADMIN and (each.expires is None or each.expires > now)
    ]


def _require_admin(tokens: Tokens, name: str | None) -> None:
    """Check that the administrator's token is still valid. This is checked while the file is locked, in case
    two administrators revoke each other's tokens at the same time.
    """
    if name is not None and all(each.name != name for each in _admins(tokens)):
        raise PermissionDenied(f"{name} is not the name of a valid token of an administrator")


def _names(tokens: Tokens) -> str:
    more = len(tokens) - MAX_LISTED
    listed = ", ".join(each.name for each in tokens[:MAX_LISTED]) or "none"
    return f"{listed} and {more} more" if more > 0 else listed
