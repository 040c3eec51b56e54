"""`cobot doctor`: checks whether this computer can run the real-time cycle on time, and prints commands that
help.

The checks only read and probe; they change nothing. This module is long because it lists everything that can
be wrong with a computer.
"""

from __future__ import annotations

import grp
import io
import json
import os
import pwd
import re
import shlex
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import TextIO

from cobot.config import Settings, load_settings
from cobot.errors import CobotError
from cobot.ipc.memory_file import FOLDER, user_of
from cobot.ipc.recording_memory import ring_bytes
from cobot.ipc.shm import MemoryRole, memory_bytes
from cobot.launch.check import check
from cobot.launch.process import RUN_MODULE
from cobot.robot.limits import load_joint_limits

PRECISE_CLOCKS = ("tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page")
ENOUGH_LOG_BYTES, FEW_LOG_BYTES = 500_000_000, 50_000_000
WELL_CORES = 2
CONTAINER_FILES = ("/.dockerenv", "/run/.containerenv")
UDEV_FILE = "/etc/udev/rules.d/90-cobot.rules"
LIMITS_FILE = "/etc/security/limits.d/90-cobot.conf"


class Severity(StrEnum):
    """The severity of a finding."""

    OK = "ok"
    WARNING = "warning"  # the feature works, but less well
    PROBLEM = "problem"  # the feature does not work


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """One line of the report of `cobot doctor`. `remedy` is the command that solves the problem."""

    item: str
    verdict: Severity
    found: str
    remedy: str = ""


class Machine:
    """The files in which Linux describes the computer.

    Args:
        root: root folder of these files. Tests use a different one.
    """

    def __init__(self, root: Path = Path("/")) -> None:
        self._root = root

    def path(self, name: str) -> Path:
        return self._root / name.lstrip("/")

    def read(self, name: str) -> str:
        """The text of a file; "" if the file cannot be read."""
        try:
            return self.path(name).read_text(encoding="utf-8", errors="replace").strip()
        except OSError:
            return ""

    def each(self, folder: str, pattern: str) -> list[str]:
        """The contents of all files that match."""
        files = sorted(self.path(folder).glob(pattern))
        return [file.read_text(encoding="utf-8", errors="replace").strip() for file in files]

    @property
    def in_container(self) -> bool:
        return any(self.path(name).exists() for name in CONTAINER_FILES)


def doctor(
    config: Path | None, out: TextIO, *, as_json: bool = False, machine: Machine | None = None
) -> bool:
    """Examine this computer and the configuration.

    Returns:
        True if no problem was found. Warnings are not problems.
    """
    findings = list(_findings(config, machine or Machine()))
    if as_json:
        print(json.dumps([asdict(finding) for finding in findings], indent=2), file=out)
    else:
        for finding in findings:
            print(f"{finding.verdict:<8} {finding.item}: {finding.found}", file=out)
            if finding.remedy:
                print(f"         type: {finding.remedy}", file=out)
    return all(finding.verdict is not Severity.PROBLEM for finding in findings)


def _findings(config: Path | None, machine: Machine) -> Iterator[Diagnosis]:
    try:
        settings = load_settings(config)
    except CobotError as exc:
        yield Diagnosis("settings", Severity.PROBLEM, str(exc), f"{_cobot()} check{_option(config)}")
        settings = load_settings()
        config = None
    else:
        yield from configuration(settings, config)
    yield kernel(machine)
    yield governor(machine)
    yield clock_source(machine)
    yield cores(len(os.sched_getaffinity(0)))
    for name, each in settings.each.items():
        yield isolation(machine, name, each.rt.cpu, max(os.sched_getaffinity(0)))
        yield from permissions(machine, name, config)
    yield shared_memory(settings, FOLDER, machine)
    yield log_disk(settings.logs)
    if settings.web.enabled:
        yield port(settings, machine)
    yield compiler(Path(__file__).parents[2])


def configuration(settings: Settings, config: Path | None) -> Iterator[Diagnosis]:
    """The findings of `cobot check`. Items without an error are only counted."""
    items = check(settings, config, io.StringIO())
    wrong = [item for item in items if not item.good]
    for item in wrong:
        where = config or "a settings file of yours"
        yield Diagnosis(item.item, Severity.PROBLEM, item.found, f'"${{EDITOR:-vi}}" {where}')
    if not wrong:
        yield Diagnosis("configuration", Severity.OK, f"{len(items)} items are good, see `cobot check`")


def kernel(machine: Machine) -> Diagnosis:
    """Check whether the kernel is a real-time kernel, which runs a process without delay when it is due."""
    version = machine.read("/proc/sys/kernel/version")
    found = f"Linux {machine.read('/proc/sys/kernel/osrelease')} {version}"
    if "PREEMPT_RT" in version or machine.read("/sys/kernel/realtime") == "1":
        return Diagnosis("kernel", Severity.OK, found)
    kind = "amd64" if os.uname().machine == "x86_64" else "arm64"
    return Diagnosis(
        "kernel",
        Severity.WARNING,
        f"{found}: not PREEMPT_RT, so some cycles begin late when the computer is busy",
        f"sudo apt-get install linux-image-rt-{kind} && sudo reboot",
    )


def governor(machine: Machine) -> Diagnosis:
    """Check whether the cores slow down when they are idle. They are idle between two cycles."""
    found = machine.each("/sys/devices/system/cpu", "cpu[0-9]*/cpufreq/scaling_governor")
    if not found:
        return Diagnosis("governor", Severity.OK, "Linux does not control the CPU frequency here")
    slow = sorted({each for each in found if each != "performance"})
    if not slow:
        return Diagnosis("governor", Severity.OK, f"performance on all {len(found)} cores")
    return Diagnosis(
        "governor",
        Severity.WARNING,
        f"{', '.join(slow)} on {sum(each in slow for each in found)} of {len(found)} cores: slow to wake up",
        "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
    )


def clock_source(machine: Machine) -> Diagnosis:
    """Check whether the time can be read without a system call."""
    folder = "/sys/devices/system/clocksource/clocksource0"
    clock = machine.read(f"{folder}/current_clocksource")
    if not clock or clock in PRECISE_CLOCKS:
        return Diagnosis("clock", Severity.OK, clock or "Linux does not report the clock")
    available = machine.read(f"{folder}/available_clocksource").split()
    better = next((each for each in PRECISE_CLOCKS if each in available), None)
    remedy = f"echo {better} | sudo tee {folder}/current_clocksource"
    if better is None:
        remedy = _kernel_option("tsc=reliable")
    return Diagnosis("clock", Severity.WARNING, f"{clock}: reading the time takes microseconds", remedy)


def cores(count: int) -> Diagnosis:
    """Check whether there is a core for the cycle, in addition to the cores that planning and the service
    use.
    """
    found = f"{count} for this process"
    if count >= WELL_CORES:
        return Diagnosis("cores", Severity.OK, found)
    remedy = f"taskset --cpu-list 0-{(os.cpu_count() or 2) - 1} {_cobot()} run"
    return Diagnosis("cores", Severity.WARNING, f"{found}: the cycle shares the core with planning", remedy)


def isolation(machine: Machine, robot: str, cpu: int | None, last: int) -> Diagnosis:
    """Check whether the real-time process has a core to itself."""
    item = f"isolation {robot}"
    isolated = _numbers(machine.read("/sys/devices/system/cpu/isolated"))
    shown = f"isolated cores: {', '.join(map(str, sorted(isolated))) or 'none'}"
    if cpu is not None and cpu in isolated:
        return Diagnosis(item, Severity.OK, f"rt.cpu is {cpu}; {shown}")
    core = cpu if cpu is not None else min(isolated, default=last)
    said = "null: the cycle runs on any core" if cpu is None else f"{cpu}, which other processes use too"
    own = f"rt: {{cpu: {core}}} in the settings, and: " if cpu is None else ""
    remedy = f"{own}{_kernel_option(f'isolcpus={core} nohz_full={core} rcu_nocbs={core}')}"
    if cpu is None and isolated:
        remedy = f"rt: {{cpu: {core}}} in the settings"
    return Diagnosis(item, Severity.WARNING, f"rt.cpu is {said}; {shown}", remedy)


def permissions(machine: Machine, robot: str, config: Path | None) -> Iterator[Diagnosis]:
    """Find the privileges that rtloop would get, by requesting them."""
    command = [*RUN_MODULE, "rtloop", "--permissions", "--robot", robot]
    command += ["--config", str(config)] if config else []
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        granted = json.loads(done.stdout)
    except ValueError:
        said = (done.stdout + done.stderr).strip().splitlines() or [f"status {done.returncode}"]
        yield Diagnosis(
            f"permissions {robot}", Severity.PROBLEM, f"rtloop does not start: {said[-1]}", _check(config)
        )
        return
    refused = dict(part.partition(": ")[::2] for part in granted["refused"].split("; ") if part)
    for item, asked, remedy in (
        ("SCHED_FIFO", "SCHED_FIFO", _limits_remedy(machine)),
        ("memory lock", "locked memory", _limits_remedy(machine)),
        ("core sleep", "rt.cpu_latency_us", _awake_remedy(machine)),
    ):
        why = next((text for name, text in refused.items() if name.startswith(asked)), None)
        if why is None:
            yield Diagnosis(f"{item} {robot}", Severity.OK, "granted")
        else:
            yield Diagnosis(f"{item} {robot}", Severity.WARNING, f"refused: {why}", remedy)


def _awake_remedy(machine: Machine) -> str:
    if machine.in_container:
        return "docker run --user root --device /dev/cpu_dma_latency ..."
    group = grp.getgrgid(os.getgid()).gr_name
    rule = f'KERNEL=="cpu_dma_latency", GROUP="{group}", MODE="0660"'
    trigger = "sudo udevadm control --reload && sudo udevadm trigger --name-match=cpu_dma_latency"
    return f"echo '{rule}' | sudo tee {UDEV_FILE} && {trigger}"


def _limits_remedy(machine: Machine) -> str:
    if machine.in_container:
        return (
            "docker run --ulimit rtprio=98 --ulimit memlock=-1 --ulimit nice=30 ... (compose.yaml has them)"
        )
    user = pwd.getpwuid(os.getuid()).pw_name
    lines = "".join(rf"{user} - {limit}\n" for limit in ("rtprio 98", "memlock unlimited", "nice -10"))
    return (
        f"printf '{lines}' | sudo tee {LIMITS_FILE}    # then log in again; `cobot install` needs none of it"
    )


def _memory_bytes(settings: Settings) -> int:
    dof, rt = load_joint_limits(settings.web.joint_limits).dof, settings.rt
    return memory_bytes(dof, rt.trajectory_capacity) + ring_bytes(dof, rt.period_s, settings.recording.ring_s)


def shared_memory(settings: Settings, folder: Path, machine: Machine) -> Diagnosis:
    """Check whether there is room for the robots' shared memory."""
    need = sum(
        _memory_bytes(each)
        for name, each in settings.each.items()
        if not user_of(name, MemoryRole.SUPERVISOR) and each.web.joint_limits.is_file()
    )
    usage = shutil.disk_usage(folder)
    found = f"{folder}: {_mb(usage.free)} of {_mb(usage.total)} free, {_mb(need)} needed"
    if usage.free >= need:
        return Diagnosis("shared memory", Severity.OK, found)
    size = f"{-(-(usage.used + 2 * need) // 1_000_000)}M"
    remedy = (
        f"docker run --shm-size={size} ..."
        if machine.in_container
        else f"sudo mount -o remount,size={size} {folder}"
    )
    found += "; or a smaller rt.trajectory_capacity or recording.ring_s"
    return Diagnosis("shared memory", Severity.PROBLEM, found, remedy)


def log_disk(folder: Path) -> Diagnosis:
    """Check whether there is room for logs, audit and recordings."""
    there = next(each for each in (folder, *folder.parents) if each.exists())
    free = shutil.disk_usage(there).free
    found = f"{folder}: {_mb(free)} free"
    if free >= ENOUGH_LOG_BYTES:
        return Diagnosis("log disk", Severity.OK, found)
    verdict = Severity.WARNING if free >= FEW_LOG_BYTES else Severity.PROBLEM
    return Diagnosis(
        "log disk", verdict, found, f"sudo du -xh --max-depth=2 {shlex.quote(str(there))} | sort -h"
    )


def port(settings: Settings, machine: Machine) -> Diagnosis:
    """Check whether the service can listen on its port. If not, name the process that uses the port."""
    host, number = settings.web.host, settings.web.port
    found = f"{host} port {number}"
    try:
        family, _, _, _, address = socket.getaddrinfo(host, number, type=socket.SOCK_STREAM)[0]
        with closing(socket.socket(family, socket.SOCK_STREAM)) as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
    except (OSError, ValueError) as exc:  # ValueError: not a valid host name
        pid = listening(machine, number)
        if pid is not None and pid == user_of(settings.robot.name, MemoryRole.SUPERVISOR):
            return Diagnosis("port", Severity.OK, f"{found}: cobot itself listens, pid {pid}")
        reason = getattr(exc, "strerror", None) or str(exc)
        whose = f", by pid {pid}: {_command(machine, pid)}" if pid else ""
        remedy = (
            f"kill {pid}    # or another web.port"
            if pid
            else f"{_cobot()} run --port 0    # or another web.port"
        )
        return Diagnosis("port", Severity.PROBLEM, f"{found}: {reason}{whose}", remedy)
    return Diagnosis("port", Severity.OK, f"{found} is free")


def listening(machine: Machine, number: int) -> int | None:
    """The first process that listens on a TCP port; None if no such process is visible."""
    inodes = set()
    for table in ("tcp", "tcp6"):
        for line in machine.read(f"/proc/net/{table}").splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and int(fields[1].rpartition(":")[2], 16) == number:
                inodes.add(f"socket:[{fields[9]}]")
    for process in sorted(machine.path("/proc").glob("[0-9]*"), key=lambda each: int(each.name)):
        try:
            if any(os.readlink(each) in inodes for each in (process / "fd").iterdir()):
                return int(process.name)
        except OSError:  # it has ended, or belongs to another user
            continue
    return None


def compiler(checkout: Path) -> Diagnosis:
    """Check whether a compiler is present. It is only needed to build cobot, see setup.py."""
    if not (checkout / "setup.py").is_file():
        return Diagnosis("compiler", Severity.OK, "not needed: cobot is installed")
    command = [sys.executable, "setup.py", "preflight"]
    done = subprocess.run(command, cwd=checkout, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return Diagnosis("compiler", Severity.OK, "found; the checkout needs it")
    remedy = "sudo apt-get install gcc python3-dev"
    return Diagnosis("compiler", Severity.PROBLEM, done.stderr.strip(), remedy)


def _command(machine: Machine, pid: int) -> str:
    return machine.read(f"/proc/{pid}/cmdline").replace("\0", " ").strip()[:80]


def _numbers(text: str) -> set[int]:
    """Parse a Linux list of cores, such as "2,4-6"."""
    found: set[int] = set()
    for low, high in re.findall(r"(\d+)(?:-(\d+))?", text):
        found.update(range(int(low), int(high or low) + 1))
    return found


def _kernel_option(options: str) -> str:
    edit = f"sudo sed -i 's/^GRUB_CMDLINE_LINUX=\"/&{options} /' /etc/default/grub"
    return f"{edit} && sudo update-grub && sudo reboot"


def _cobot() -> str:
    return shlex.quote(sys.argv[0]) if Path(sys.argv[0]).name == "cobot" else "cobot"


def _option(config: Path | None) -> str:
    return f" --config {shlex.quote(str(config))}" if config else ""


def _check(config: Path | None) -> str:
    return f"{_cobot()} check{_option(config)}"


def _mb(size: int) -> str:
    return f"{size / 1e6:.0f} MB"
