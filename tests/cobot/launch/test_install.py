"""`cobot install`. Oracles: the files themselves, `patch`'s format read back, and systemd-analyze."""

from __future__ import annotations

import io
import shutil
import subprocess
from pathlib import Path

import pytest

from cobot.access.authentication import Authenticator, Holder
from cobot.access.roles import Role
from cobot.access.tokens import TokenFile
from cobot.config import load_settings
from cobot.launch import install as module
from cobot.launch.cli import main
from cobot.launch.install import ENABLED, InstallError, install, uninstall

COMMAND = ["/opt/cobot/bin/python", "-P", "-m", "cobot"]
UNIT = "etc/systemd/system/cobot.service"
SETTINGS = "etc/cobot/cobot-setting.yaml"


def installed(prefix: Path, *, dry_run: bool = False) -> str:
    out = io.StringIO()
    install(out, prefix, dry_run=dry_run, command=COMMAND)
    return out.getvalue()


def tree(prefix: Path) -> dict[str, str]:
    files = (file for file in prefix.rglob("*") if file.is_file())
    return {str(file.relative_to(prefix)): file.read_text(encoding="utf-8") for file in files}


def told(report: str) -> dict[str, str]:
    """The files that a report says are created, from the lines that it shows of them."""
    files: dict[str, list[str]] = {}
    path = ""
    for line in report.splitlines():
        word, _, rest = line.partition(" ")
        if word in ("create", "change", "unchanged"):
            path = rest.strip().lstrip("/")
            if word == "create":
                files[path] = []
        elif line.startswith("    +") and not line.startswith("    +++"):
            files[path].append(line.removeprefix("    +"))
    return {name: "\n".join(lines) + "\n" for name, lines in files.items()}


def test_a_dry_run_prints_exactly_what_an_installation_writes(tmp_path: Path) -> None:
    report = installed(tmp_path, dry_run=True)
    assert tree(tmp_path) == {}
    assert installed(tmp_path).startswith(report)
    assert tree(tmp_path) == told(report)
    assert set(told(report)) == {
        *(UNIT, SETTINGS, "etc/sysusers.d/cobot.conf", "etc/systemd/journald@cobot.conf"),
        "etc/udev/rules.d/90-cobot.rules",
    }


def test_a_second_installation_changes_nothing(tmp_path: Path) -> None:
    installed(tmp_path)
    before = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*")}
    assert all(line.startswith(("unchanged", "next")) for line in installed(tmp_path).splitlines())
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*")} == before


def test_an_update_shows_the_difference_and_leaves_edited_settings(tmp_path: Path) -> None:
    installed(tmp_path)
    (tmp_path / UNIT).write_text((tmp_path / UNIT).read_text().replace("WatchdogSec=10", "WatchdogSec=99"))
    (tmp_path / SETTINGS).write_text("web: {port: 9000}\n", encoding="utf-8")
    report = installed(tmp_path)
    assert f"change    /{UNIT}" in report
    assert "    -WatchdogSec=99" in report
    assert "    +WatchdogSec=10" in report
    assert f"unchanged /{SETTINGS}: edited, left as it is" in report
    assert (tmp_path / SETTINGS).read_text(encoding="utf-8") == "web: {port: 9000}\n"
    assert "WatchdogSec=10\n" in (tmp_path / UNIT).read_text(encoding="utf-8")


def test_uninstall_takes_away_what_was_written_and_keeps_what_was_edited(tmp_path: Path) -> None:
    installed(tmp_path)
    out = io.StringIO()
    uninstall(out, tmp_path, dry_run=True)
    assert len(tree(tmp_path)) == 5
    uninstall(io.StringIO(), tmp_path, dry_run=False)
    assert tree(tmp_path) == {}
    uninstall(out, tmp_path, dry_run=False)
    installed(tmp_path)
    (tmp_path / SETTINGS).write_text("web: {port: 9000}\n", encoding="utf-8")
    uninstall(out, tmp_path, dry_run=False)
    assert tree(tmp_path) == {SETTINGS: "web: {port: 9000}\n"}
    assert f"kept      /{SETTINGS}: it was edited" in out.getvalue()


def test_the_settings_that_it_writes_are_valid(tmp_path: Path) -> None:
    installed(tmp_path)
    settings = load_settings(tmp_path / SETTINGS)
    assert settings.logs == Path("/var/log/cobot")
    assert settings.sequences.recordings == Path("/var/lib/cobot/recordings")
    assert settings.tool_file.parent == Path("/var/lib/cobot/kept")
    assert not settings.robots


def test_a_token_made_by_root_is_one_of_the_service(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each has another home, and the service cannot look into root's."""
    installed(tmp_path)
    config = tmp_path / SETTINGS
    config.write_text(config.read_text(encoding="utf-8").replace("/var/", f"{tmp_path}/var/"))
    monkeypatch.setenv("HOME", str(tmp_path / "of-root"))
    assert main(["token", "create", "alice", "--role", "operator", "--config", str(config)]) == 0
    made = capsys.readouterr()
    assert made.err == f"in {tmp_path}/var/lib/cobot/tokens.json\n"
    monkeypatch.setenv("HOME", str(tmp_path / "var/lib/cobot"))
    service = Authenticator(TokenFile(load_settings(config).web.tokens))
    assert service.find(made.out.strip()) == Holder("alice", Role.OPERATOR, stored=True)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd to ask")
def test_systemd_understands_the_unit(tmp_path: Path) -> None:
    install(io.StringIO(), tmp_path, dry_run=False)  # with a command that exists
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(tmp_path / UNIT)],
        capture_output=True,
        text=True,
        check=False,
    )
    about_ours = [line for line in done.stderr.splitlines() if "cobot" in line]
    assert (done.returncode, about_ours) == (0, [])


def test_the_unit_gives_what_a_punctual_cycle_needs_and_no_more(tmp_path: Path) -> None:
    installed(tmp_path)
    lines = (tmp_path / UNIT).read_text(encoding="utf-8").splitlines()
    for line in (
        *("Type=notify", "WatchdogSec=10", "User=cobot", "LimitRTPRIO=98", "LimitMEMLOCK=infinity"),
        *("LimitNICE=-10", "KillMode=mixed", "CapabilityBoundingSet=", "NoNewPrivileges=yes"),
        "ExecStart=/opt/cobot/bin/python -P -m cobot run --config /etc/cobot/cobot-setting.yaml",
        'ExecReload=/bin/sh -c "kill -HUP $MAINPID"',
    ):
        assert line in lines
    assert not any(line.startswith("CPUScheduling") for line in lines)  # rtloop alone asks for it


def test_the_system_is_told_only_of_what_has_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a system that is a folder, and commands that are only written down."""
    ran: list[list[str]] = []

    fails = [True]

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        ran.append(command)
        enabling = command[1] == "enable"
        if enabling and not fails[0]:
            link = tmp_path / ENABLED.relative_to("/")
            link.parent.mkdir()
            link.symlink_to(UNIT)
        return subprocess.CompletedProcess(command, int(enabling and fails[0]), "", "no bus\n")

    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setattr(module, "_below", lambda _, path: tmp_path / path.relative_to("/"))
    monkeypatch.setattr(module, "_require_system", lambda _: None)
    monkeypatch.setattr(module, "_require_readable", lambda _: None)
    out = io.StringIO()
    install(out, None, dry_run=True, command=COMMAND)
    assert ran == []
    with pytest.raises(InstallError, match=r"systemctl enable cobot\.service: no bus"):
        install(io.StringIO(), None, dry_run=False, command=COMMAND)
    lines = [
        line.removeprefix("run       ") for line in out.getvalue().splitlines() if line.startswith("run")
    ]
    assert [" ".join(command) for command in ran] == lines
    assert lines == [
        "systemd-sysusers /etc/sysusers.d/cobot.conf",
        "udevadm control --reload",
        "udevadm trigger --name-match=cpu_dma_latency",
        "systemctl daemon-reload",
        "systemctl enable cobot.service",
    ]
    fails[0] = False
    install(io.StringIO(), None, dry_run=False, command=COMMAND)  # what has failed is done now
    assert ran[5:] == ran[:5]
    install(io.StringIO(), None, dry_run=False, command=COMMAND)
    assert len(ran) == 10
    uninstall(io.StringIO(), None, dry_run=False)
    assert [" ".join(command) for command in ran[10:]] == [
        "systemctl disable --now cobot.service",
        "systemctl daemon-reload",
    ]


def test_a_command_that_fails_is_named_with_what_it_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 1, "", "no bus\n")

    with pytest.raises(InstallError, match="systemctl daemon-reload: no bus"):
        module._run([["systemctl", "daemon-reload"]], io.StringIO(), False, run)
    out = io.StringIO()
    module._run([["udevadm", "control", "--reload"]], out, False, run)  # a container has no udev
    assert "warning   udevadm control --reload: no bus" in out.getvalue()


def test_an_installation_that_the_service_could_not_read_is_refused(tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    python = closed / "venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    closed.chmod(0o700)
    with pytest.raises(InstallError, match=rf"other users cannot read {closed}.*python3 -m venv /opt/cobot"):
        install(io.StringIO(), None, dry_run=True, command=[str(python)])


def test_who_is_not_root_is_told_what_to_type(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    monkeypatch.setattr(module, "_require_readable", lambda _: None)
    assert main(["install"]) == 1
    assert "type sudo cobot install; --dry-run and --prefix need no root" in capsys.readouterr().err
    assert main(["uninstall"]) == 1


def test_a_computer_without_systemd_is_told_of_the_other_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setattr("os.geteuid", lambda: 0)
    with pytest.raises(InstallError, match=r"systemd not found: use `cobot run`, or the container"):
        module._require_system("cobot install")
