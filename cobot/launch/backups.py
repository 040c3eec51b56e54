"""`cobot backup`, `cobot restore` and `cobot support`: docs/how-to/back-up-and-restore.md."""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import sys
from pathlib import Path

from cobot.audit import record_from_cli
from cobot.commands import options
from cobot.config import Settings, load_settings
from cobot.errors import CobotError, ConflictError, InputError, UnavailableError
from cobot.foreign import plain_lines
from cobot.launch.backup.archive import MAX_ARCHIVE_BYTES
from cobot.launch.backup.backup import Backup, activate, make_backup, read_backup, stage, staged_file
from cobot.launch.backup.support import make_bundle
from cobot.launch.supervisor.kept_lock import locking_kept_files

SUPPORT_TIMEOUT_S = 60.0
EXISTS = "already exists; choose another name, or remove it first"
log = logging.getLogger("cobot.backup")


def run(chosen: argparse.Namespace) -> None:
    """Execute the command.

    Raises:
        CobotError: a file cannot be read or written, or the archive is rejected.
    """
    settings = load_settings(chosen.config)
    match chosen.command:
        case "backup":
            _write(chosen.file, make_backup(settings, chosen.config))
            print(chosen.file)
        case "support":
            _support(chosen, settings)
            print(chosen.file)
        case "restore":
            _restore(chosen, settings)


def restore_staged(settings: Settings, config: Path | None) -> Settings:
    """Restore a staged backup before a start, and return the settings for the start.

    A backup that cannot be restored does not prevent the start; the log gives the reason.
    """
    if not staged_file(settings).exists():
        return settings
    try:
        with locking_kept_files(settings):
            restored = activate(settings, config)
    except InputError as exc:
        log.error("the restore was rejected: %s", exc)
        return settings
    log.info("restored a backup of %s: %s", restored.about.get("created"), "; ".join(restored.summary))
    record_from_cli(settings, f"restore of the backup of {restored.about.get('created')}")
    return load_settings(config)


def _restore(chosen: argparse.Namespace, settings: Settings) -> None:
    content = _content(chosen.file)
    backup = read_backup(content, settings)
    stage(settings, content)
    try:
        with locking_kept_files(settings):
            activate(settings, chosen.config)
    except ConflictError:
        _tell(backup, "cobot is running, so the next start will restore the backup")
        return
    record_from_cli(settings, f"restore {chosen.file}")
    _tell(backup, "restored")
    if backup.settings is not None and chosen.config is None:
        print("the settings file was not restored: name it with --config", file=sys.stderr)


def _tell(backup: Backup, what: str) -> None:
    print(f"{what}, as of {backup.about.get('created')}:")
    for line in backup.summary:
        print(f"  {line}")


def _support(chosen: argparse.Namespace, settings: Settings) -> None:
    """Write a support bundle with data from the service. If the service does not answer, the bundle contains
    only the files.
    """
    from cobot.client.rest import Client  # `cobot run` also needs this module, but no client

    if chosen.file.exists():
        raise InputError(f"{chosen.file}: {EXISTS}")
    verify = True if chosen.certificate is None else chosen.certificate
    try:
        url = options.url_of(chosen)
        with Client(url, token=chosen.token, verify=verify, timeout_s=SUPPORT_TIMEOUT_S) as client:
            client.fetch_support(chosen.file)
    except UnavailableError as exc:
        print(f"cobot: {plain_lines(exc)}; the bundle contains only local files", file=sys.stderr)
        _write(chosen.file, make_bundle(settings, {}))


def _content(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(MAX_ARCHIVE_BYTES + 1)
    except OSError as exc:
        raise InputError(f"{path}: cannot be read: {exc.strerror}") from exc


def _write(path: Path, content: bytes) -> None:
    """Create a file that only its owner can read. An existing file is never overwritten."""
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(content)
    except FileExistsError as exc:
        raise InputError(f"{path}: {EXISTS}") from exc
    except OSError as exc:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
        raise CobotError(f"{path}: cannot be written: {exc.strerror}") from exc
