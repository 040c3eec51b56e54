"""`cobot install` and `cobot uninstall`: cobot as a systemd service under its own user.

An installation is a list of files and a list of commands. Both are plain data (`plan`), so that `--dry-run`
prints exactly the files that an installation writes. Files that already exist with the same content are not
written.
"""

from __future__ import annotations

import difflib
import os
import shlex
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TextIO

from cobot.errors import CobotError

USER = "cobot"
SETTINGS = Path("/etc/cobot/cobot-setting.yaml")
UNIT = Path("/etc/systemd/system/cobot.service")
ENABLED = Path("/etc/systemd/system/multi-user.target.wants/cobot.service")
JOURNAL = Path("/etc/systemd/journald@cobot.conf")
UDEV = Path("/etc/udev/rules.d/90-cobot.rules")
SYSUSERS = Path("/etc/sysusers.d/cobot.conf")
STATE, LOGS = Path("/var/lib/cobot"), Path("/var/log/cobot")


class InstallError(CobotError):
    """Raised if the service cannot be installed here. The text gives the reason and the remedy."""

    code = "install"


class IfPresent(Enum):
    """Whether an installation replaces a file that already exists."""

    REPLACE = "replaced by each installation"
    KEEP = "left as it is: the settings are the user's"


@dataclass(frozen=True, slots=True)
class File:
    """A file of the installation. Missing folders are created."""

    path: Path
    content: str
    if_present: IfPresent = IfPresent.REPLACE


def files(command: Sequence[str]) -> list[File]:
    """All files, in the order of writing.

    Args:
        command: command that starts cobot, without arguments.
    """
    return [
        File(SETTINGS, _SETTINGS, IfPresent.KEEP),
        File(SYSUSERS, f'u {USER} - "cobot, a robot arm behind a REST service" {STATE}\n'),
        File(UDEV, _UDEV),
        File(JOURNAL, _JOURNAL),
        File(UNIT, _unit(command)),
    ]


def commands() -> list[list[str]]:
    """Commands that make the system read the installed files."""
    return [
        ["systemd-sysusers", str(SYSUSERS)],
        ["udevadm", "control", "--reload"],
        ["udevadm", "trigger", "--name-match=cpu_dma_latency"],
        ["systemctl", "daemon-reload"],
        ["systemctl", "enable", UNIT.name],
    ]


def install(out: TextIO, prefix: Path | None, *, dry_run: bool, command: Sequence[str] | None = None) -> None:
    """Write the files that are missing or different, make the system read them, and print each step.

    Args:
        prefix: root folder to write to instead of /. With it, only files are written and no system command
            runs.
        command: the command line that starts cobot, without arguments; None for the cobot that is running
            now.

    Raises:
        InstallError: there is no systemd, the user is not root, or the service's user cannot read the
            installation of cobot.
    """
    command = command or [sys.executable, "-P", "-m", "cobot"]
    if prefix is None:
        _require_readable(Path(command[0]))
    if prefix is None and not dry_run:
        _require_system("cobot install")
    changed = [_write(file, out, prefix or Path("/"), dry_run) for file in files(command)]
    if prefix is None and (any(changed) or not os.path.lexists(_below(Path("/"), ENABLED))):
        _run(commands(), out, dry_run, subprocess.run)
    if not dry_run:
        print(
            f"next: edit {SETTINGS}, then: systemctl restart cobot; cobot doctor --config {SETTINGS}",
            file=out,
        )


def uninstall(out: TextIO, prefix: Path | None, *, dry_run: bool) -> None:
    """Remove the files that `install` has written. Edited settings, logs, state and the system user remain.

    Raises:
        InstallError: the user is not root, or there is no systemd.
    """
    if prefix is None and not dry_run:
        _require_system("cobot uninstall")
    root = prefix or Path("/")
    there = [file for file in files([sys.executable]) if _below(root, file.path).exists()]
    if prefix is None and any(file.path == UNIT for file in there):
        _run([["systemctl", "disable", "--now", UNIT.name]], out, dry_run, subprocess.run)
    for file in reversed(there):
        target = _below(root, file.path)
        if file.if_present is IfPresent.KEEP and target.read_text(encoding="utf-8") != file.content:
            print(f"kept      {file.path}: it was edited", file=out)
            continue
        print(f"remove    {file.path}", file=out)
        if not dry_run:
            target.unlink()
    if there and prefix is None:
        _run([["systemctl", "daemon-reload"]], out, dry_run, subprocess.run)
    print(f"kept      {STATE}, {LOGS} and the user {USER}, if they exist", file=out)


def _write(file: File, out: TextIO, root: Path, dry_run: bool) -> bool:
    """Write a file if its content differs. Returns whether the file was written, or with `dry_run` would
    be.
    """
    target = _below(root, file.path)
    old = target.read_text(encoding="utf-8") if target.exists() else None
    if old is not None and (old == file.content or file.if_present is IfPresent.KEEP):
        print(f"unchanged {file.path}{'' if old == file.content else ': edited, left as it is'}", file=out)
        return False
    print(f"{'create   ' if old is None else 'change   '} {file.path}", file=out)
    before, after = (old or "").splitlines(), file.content.splitlines()
    names = "/dev/null" if old is None else str(file.path), str(file.path)
    for line in difflib.unified_diff(before, after, *names, lineterm=""):
        print(f"    {line}", file=out)
    if not dry_run:
        target.parent.mkdir(parents=True, exist_ok=True)
        new = target.with_name(f".{target.name}.new")
        new.write_text(file.content, encoding="utf-8")
        new.chmod(0o644)
        os.replace(new, target)
    return True


def _run(
    lines: list[list[str]], out: TextIO, dry_run: bool, run: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    for line in lines:
        print(f"run       {shlex.join(line)}", file=out)
        if dry_run:
            continue
        done = run(line, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            failure = f"{shlex.join(line)}: {(done.stderr or done.stdout).strip()}"
            if line[0] != "udevadm":
                raise InstallError(failure)
            print(f"warning   {failure}; this happens at the next start of the computer", file=out)


def _below(root: Path, path: Path) -> Path:
    return root / path.relative_to("/")


def _require_system(what: str) -> None:
    if os.geteuid() != 0:
        raise InstallError(
            f"{what} writes to /etc, so it needs root: type sudo {what}; --dry-run and --prefix need no root"
        )
    if shutil.which("systemctl") is None or shutil.which("systemd-sysusers") is None:
        raise InstallError("systemd not found: use `cobot run`, or the container in compose.yaml")


def _require_readable(python: Path) -> None:
    """Check that the service's user can read the installation of cobot. The check fails if the installation
    is below /root or in a home folder that other users cannot read.
    """
    for folder in (python.absolute().parent, *python.absolute().parents):
        if not folder.stat().st_mode & stat.S_IXOTH:
            raise InstallError(
                f"the user {USER} could not start {python}: other users cannot read {folder}. Install cobot "
                "where all users can read it: python3 -m venv /opt/cobot && /opt/cobot/bin/pip install "
                "WHEEL, then /opt/cobot/bin/cobot install"
            )


_SETTINGS = f"""\
# Settings of the cobot service that differ from the defaults. Keep only your own values here.
# `cobot check --config {SETTINGS}` validates them; `systemctl reload cobot` applies named positions, joint
# limits and web settings while nothing moves; everything else needs `systemctl restart cobot`.
logs: {LOGS}
kept: {STATE}/kept
sequences:
  recordings: {STATE}/recordings
  programs: {STATE}/programs
recording:
  folder: {STATE}/mcap
web:
  tokens: {STATE}/tokens.json
"""

_UDEV = f"""\
# rtloop may keep the cores awake (rt.cpu_latency_us).
KERNEL=="cpu_dma_latency", GROUP="{USER}", MODE="0660"
"""

_JOURNAL = """\
# cobot has its own journal (journalctl --namespace=cobot), so that cobot and other services do not push out
# each other's lines. cobot rotates its own files in /var/log/cobot.
[Journal]
SystemMaxUse=200M
SystemMaxFileSize=20M
MaxRetentionSec=3month
"""


def _unit(command: Sequence[str]) -> str:
    """The unit file. This function is long because it contains the whole file."""
    start = shlex.join(command)
    return f"""\
# Written by `cobot install`, and replaced by the next one. Use `systemctl edit cobot` for your own changes.
[Unit]
Description=cobot, a robot arm behind a REST service
Wants=network-online.target
After=network-online.target
StartLimitIntervalSec=60
StartLimitBurst=5

[Service]
Type=notify
NotifyAccess=main
User={USER}
Group={USER}
Environment=HOME={STATE}
WorkingDirectory={STATE}
StateDirectory={USER}
LogsDirectory={USER}
ConfigurationDirectory={USER}
ExecStart={start} run --config {SETTINGS}
ExecReload=/bin/sh -c "kill -HUP $MAINPID"

# Only the supervisor gets the signal, because it stops the arm before it ends its children. If the supervisor
# is gone, rtloop stops the arm by itself, and systemd waits for that before it kills the rest.
KillMode=mixed
ExecStopPost=-/bin/sh -c '[ "$$SERVICE_RESULT" = success ] || exec {start} stop --config {SETTINGS}'
TimeoutStartSec=60
TimeoutStopSec=20
WatchdogSec=10
Restart=on-failure
RestartSec=2

# Limits for a cycle that runs on time. Only rtloop requests SCHED_FIFO (rt.priority).
LimitRTPRIO=98
LimitMEMLOCK=infinity
LimitNICE=-10
LimitNOFILE=65536
OOMScoreAdjust=-500

# cobot needs no privilege beyond these limits, and writes only to its own folders and /dev/shm.
CapabilityBoundingSet=
NoNewPrivileges=yes
ProtectSystem=strict
ProtectHome=read-only
ReadWritePaths=/dev/shm
PrivateTmp=yes
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectHostname=yes
RestrictNamespaces=yes
RestrictSUIDSGID=yes
LockPersonality=yes
RestrictAddressFamilies=AF_INET AF_INET6 AF_UNIX AF_NETLINK
SystemCallArchitectures=native
UMask=0077

LogNamespace={USER}
SyslogIdentifier={USER}

[Install]
WantedBy=multi-user.target
"""
