"""`cobot doctor`. Oracles: made-up computers (trees of files), and the operating system's own sockets."""

from __future__ import annotations

import io
import json
import os
import shutil
import socket
import subprocess
from pathlib import Path
from typing import Any

import pytest

from cobot.config import Settings, load_settings
from cobot.launch import doctor as module
from cobot.launch.cli import main
from cobot.launch.doctor import Diagnosis, Machine, Severity

OK, WARNING, PROBLEM = Severity
CPU = "/sys/devices/system/cpu"
CLOCK = "/sys/devices/system/clocksource/clocksource0"


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the shipped settings have their logs and recordings."""
    monkeypatch.setenv("HOME", str(tmp_path))


def machine(folder: Path, files: dict[str, str]) -> Machine:
    for name, text in files.items():
        file = folder / name.lstrip("/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"{text}\n", encoding="utf-8")
    return Machine(folder)


def governors(*names: str) -> dict[str, str]:
    return {f"{CPU}/cpu{core}/cpufreq/scaling_governor": name for core, name in enumerate(names)}


@pytest.mark.parametrize(
    ("look", "files", "verdict", "found", "remedy"),
    [
        (module.kernel, {"/proc/sys/kernel/version": "#1 SMP PREEMPT_RT Debian"}, OK, "PREEMPT_RT", ""),
        (module.kernel, {"/sys/kernel/realtime": "1"}, OK, "Linux", ""),
        (
            module.kernel,
            {"/proc/sys/kernel/version": "#1 SMP PREEMPT_DYNAMIC"},
            WARNING,
            "not PREEMPT_RT",
            "sudo apt-get install linux-image-rt-",
        ),
        (module.governor, {}, OK, "Linux does not control", ""),
        (module.governor, governors("performance", "performance"), OK, "performance on all 2 cores", ""),
        (
            module.governor,
            governors("performance", "powersave", "powersave"),
            WARNING,
            "powersave on 2 of 3 cores",
            "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
        ),
        (module.clock_source, {f"{CLOCK}/current_clocksource": "tsc"}, OK, "tsc", ""),
        (
            module.clock_source,
            {f"{CLOCK}/current_clocksource": "hpet", f"{CLOCK}/available_clocksource": "tsc hpet"},
            WARNING,
            "hpet",
            f"echo tsc | sudo tee {CLOCK}/current_clocksource",
        ),
        (
            module.clock_source,
            {f"{CLOCK}/current_clocksource": "hpet", f"{CLOCK}/available_clocksource": "hpet acpi_pm"},
            WARNING,
            "hpet",
            "tsc=reliable /' /etc/default/grub",
        ),
    ],
)
def test_a_computer_is_judged_by_what_linux_says_of_it(
    tmp_path: Path, look: Any, files: dict[str, str], verdict: Severity, found: str, remedy: str
) -> None:
    finding = look(machine(tmp_path, files))
    assert finding.verdict is verdict
    assert found in finding.found
    assert remedy in finding.remedy
    assert bool(finding.remedy) == (verdict is not OK)


@pytest.mark.parametrize(
    ("cpu", "isolated", "verdict", "remedy"),
    [
        (3, "2-3", OK, ""),
        (2, "2,5-7", OK, ""),
        (3, "", WARNING, "isolcpus=3 nohz_full=3 rcu_nocbs=3"),
        (None, "", WARNING, "rt: {cpu: 7} in the settings, and: sudo sed"),
        (None, "5-6", WARNING, "rt: {cpu: 5} in the settings"),
    ],
)
def test_a_core_of_its_own_is_one_that_is_both_isolated_and_chosen(
    tmp_path: Path, cpu: int | None, isolated: str, verdict: Severity, remedy: str
) -> None:
    finding = module.isolation(machine(tmp_path, {f"{CPU}/isolated": isolated}), "iiwa", cpu, 7)
    assert (finding.verdict, finding.item) == (verdict, "isolation iiwa")
    assert remedy in finding.remedy


def test_one_core_is_too_few() -> None:
    assert module.cores(1).verdict is WARNING
    assert "taskset" in module.cores(1).remedy
    assert module.cores(2).verdict is OK


def permissions(monkeypatch: pytest.MonkeyPatch, folder: Path, output: str) -> list[Diagnosis]:
    def run(*_: object, **__: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess([], 0, output, "")

    monkeypatch.setattr(subprocess, "run", run)
    return list(module.permissions(Machine(folder), "iiwa", None))


def test_what_rtloop_is_refused_is_told_with_the_limits_to_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused = (
        "SCHED_FIFO 80: Operation not permitted, needs CAP_SYS_NICE; "
        "rt.cpu_latency_us 0: /dev/cpu_dma_latency: Permission denied; "
        "locked memory: Cannot allocate memory, needs CAP_IPC_LOCK"
    )
    answer = json.dumps({"sched_fifo": False, "memory_locked": False, "refused": refused})
    fifo, lock, sleep = permissions(monkeypatch, tmp_path, answer)
    assert (fifo.verdict, lock.verdict, sleep.verdict) == (WARNING, WARNING, WARNING)
    assert fifo.found == "refused: Operation not permitted, needs CAP_SYS_NICE"
    assert lock.found == "refused: Cannot allocate memory, needs CAP_IPC_LOCK"
    assert "rtprio 98" in fifo.remedy
    assert "memlock unlimited" in lock.remedy
    assert "/etc/security/limits.d/" in lock.remedy
    assert sleep.found == "refused: /dev/cpu_dma_latency: Permission denied"
    assert "udevadm trigger --name-match=cpu_dma_latency" in sleep.remedy
    machine(tmp_path, {"/.dockerenv": ""})
    assert "docker run --ulimit rtprio=98" in permissions(monkeypatch, tmp_path, answer)[0].remedy


def test_an_rtloop_that_does_not_start_is_a_problem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (finding,) = permissions(monkeypatch, tmp_path, "no such module")
    assert finding.verdict is PROBLEM
    assert "no such module" in finding.found


def test_shared_memory_that_is_too_small_is_a_problem_with_the_size_that_would_do(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    finding = module.shared_memory(settings, tmp_path, Machine(tmp_path))
    assert (finding.verdict, finding.remedy) == (OK, "")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(64_000_000, 0, 64_000_000))
    finding = module.shared_memory(settings, tmp_path, Machine(tmp_path))
    assert finding.verdict is PROBLEM
    assert "64 MB of 64 MB free, 130 MB needed" in finding.found
    assert "rt.trajectory_capacity" in finding.found
    assert finding.remedy == f"sudo mount -o remount,size=260M {tmp_path}"
    in_container = module.shared_memory(settings, tmp_path, machine(tmp_path, {"/.dockerenv": ""}))
    assert "docker run --shm-size=260M" in in_container.remedy


@pytest.mark.parametrize(("free", "verdict"), [(10**9, OK), (10**8, WARNING), (10**7, PROBLEM)])
def test_little_room_for_logs_is_told_in_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, verdict: Severity
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**10, 0, free))
    finding = module.log_disk(tmp_path / "not" / "yet")
    assert finding.verdict is verdict
    assert (str(tmp_path) in finding.remedy) == (verdict is not OK)


def test_who_has_the_port_is_named(settings: Settings) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
        web = settings.web.model_copy(update={"port": number})
        finding = module.port(settings.model_copy(update={"web": web}), Machine())
    assert finding.verdict is PROBLEM
    assert f"127.0.0.1 port {number}: Address already in use, by pid {os.getpid()}: " in finding.found
    assert finding.remedy == f"kill {os.getpid()}    # or another web.port"
    free = settings.web.model_copy(update={"port": 0})
    assert module.port(settings.model_copy(update={"web": free}), Machine()).verdict is OK


def test_a_port_that_nobody_can_give_is_a_problem(settings: Settings) -> None:
    web = settings.web.model_copy(update={"host": "192.0.2.1"})
    finding = module.port(settings.model_copy(update={"web": web}), Machine())
    assert finding.verdict is PROBLEM
    assert "192.0.2.1 port 8007: Cannot assign requested address" in finding.found


def test_a_compiler_is_asked_for_in_a_checkout_only(tmp_path: Path) -> None:
    assert module.compiler(tmp_path).found == "not needed: cobot is installed"
    (tmp_path / "setup.py").write_text("import sys\nsys.exit('cobot needs a C compiler: install gcc')\n")
    finding = module.compiler(tmp_path)
    assert finding.verdict is PROBLEM
    assert finding.found == "cobot needs a C compiler: install gcc"
    assert "apt-get install gcc" in finding.remedy
    assert module.compiler(Path(__file__).parents[3]).verdict is OK


def test_the_report_names_what_to_type_and_its_status_says_whether_there_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    findings = [
        Diagnosis("a", OK, "good"),
        Diagnosis("b", WARNING, "slow", "sudo faster"),
    ]
    monkeypatch.setattr(module, "_findings", lambda *_: iter(findings))
    assert main(["doctor"]) == 0
    assert capsys.readouterr().out == "ok       a: good\nwarning  b: slow\n         type: sudo faster\n"
    findings.append(Diagnosis("c", PROBLEM, "broken", "mend"))
    assert main(["doctor", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert [each["verdict"] for each in told] == ["ok", "warning", "problem"]
    assert told[2] == {"item": "c", "verdict": "problem", "found": "broken", "remedy": "mend"}


def test_this_computer_is_examined_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    module.doctor(None, out, as_json=True)
    items = [each["item"] for each in json.loads(out.getvalue())]
    assert items == [
        *("configuration", "kernel", "governor", "clock", "cores", "isolation iiwa"),
        *(
            "SCHED_FIFO iiwa",
            "memory lock iiwa",
            "core sleep iiwa",
            "shared memory",
            "log disk",
            "port",
            "compiler",
        ),
    ]


def test_settings_that_cannot_be_read_do_not_hide_the_rest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("wbe: {}\n", encoding="utf-8")
    monkeypatch.setattr(module, "permissions", lambda *_: iter(()))
    assert main(["doctor", "--config", str(file)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"problem  settings: {file}: unknown key 'wbe'")
    assert lines[1] == f"         type: cobot check --config {file}"
    assert any("kernel: Linux" in line for line in lines)


def test_what_is_wrong_in_the_configuration_is_a_problem_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("robot: {start_position: hom}\nweb: {endpoints: no.yaml}\n", encoding="utf-8")
    findings = list(module.configuration(load_settings(file), file))
    assert [each.item for each in findings] == ["endpoints", "robot"]
    assert all(each.verdict is PROBLEM and str(file) in each.remedy for each in findings)
