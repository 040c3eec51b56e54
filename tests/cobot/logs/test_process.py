"""A process whose output nobody takes: it goes on all the same, and says later what was lost.

Oracle: the operating system's pipes; a pipe that nobody reads is full after 64 KiB.
"""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import pytest
from cobot_run import HELPER_ENVIRONMENT, WAIT_S

from cobot.logs.lines import RECORD_SEPARATOR
from cobot.logs.process import SUPERVISED

SAID_S = 20.0
"""For what takes milliseconds, or for ever."""


class Child:
    """Runs code with its output in a pipe, which is read when the test wants it."""

    def __init__(self, code: str, *, blocking: bool = False, supervised: bool = True) -> None:
        read_end, write_end = os.pipe()
        os.set_blocking(write_end, blocking)
        ready, self._ready = os.pipe()
        self.output: BinaryIO = os.fdopen(read_end, "rb")
        started = "from cobot.logs import start_logging\nstart_logging('child')\n"
        done = f"\nimport os\nos.write({self._ready}, b'done')\n"
        environment = HELPER_ENVIRONMENT | ({SUPERVISED: "1"} if supervised else {})
        self.process = subprocess.Popen(
            [sys.executable, "-c", started + code.replace("DONE", done.replace("\n", ";").strip(";"))],
            stdout=write_end,
            stderr=write_end,
            pass_fds=(self._ready,),
            env=environment,
        )
        os.close(write_end)
        os.close(self._ready)
        self.done: BinaryIO = os.fdopen(ready, "rb")

    def finish(self) -> None:
        """Until it has got through all of its code."""
        assert self.done.read(4) == b"done"

    def lines(self) -> Iterator[bytes]:
        yield from self.output

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self.output.close()
        self.done.close()


@pytest.fixture
def children() -> Iterator[list[Child]]:
    made: list[Child] = []
    yield made
    for each in made:
        each.close()


FLOOD = """
import logging, sys, time, warnings, threading, traceback
begun = time.monotonic()
for n in range(20000):
    logging.getLogger(f"cobot.{n % 500}").warning("%06d %s", n, "x" * 100)
    if n % 100 == 0:
        print("printed " + "y" * 200)
        print("printed " + "z" * 200, file=sys.stderr)
        warnings.warn(f"warned {n}", stacklevel=1)
try:
    1 / 0
except ZeroDivisionError:
    logging.getLogger("cobot").exception("a traceback")
    traceback.print_exc()
thread = threading.Thread(target=lambda: 1 / 0)
thread.start()
thread.join()
assert time.monotonic() - begun < 15.0
DONE
time.sleep(WAIT)
logging.getLogger("cobot.after").warning("there is room again")
"""


@pytest.mark.parametrize("blocking", [False, True], ids=["the supervisor's pipe", "somebody's pipe"])
def test_nothing_waits_for_a_full_pipe_and_the_loss_is_said(children: list[Child], blocking: bool) -> None:
    child = Child(FLOOD.replace("WAIT", "0.5"), blocking=blocking)
    children.append(child)
    child.finish()  # of its output nothing was read so far
    sent = [json.loads(line[1:]) for line in child.lines() if line[:1] == RECORD_SEPARATOR]
    assert child.process.wait(WAIT_S) == 0
    messages = [each["message"] for each in sent]
    lost = [message for message in messages if "lines of this log were lost" in message]
    assert lost
    assert "there is room again" in messages
    numbers = [int(message[:6]) for message in messages if message[:6].isdigit()]
    assert numbers == sorted(numbers), "in the order in which they were said"
    assert len(numbers) >= 100


def test_a_process_ends_though_nobody_takes_its_last_lines(children: list[Child]) -> None:
    child = Child(FLOOD.replace("WAIT", "0"))
    children.append(child)
    child.finish()
    assert child.process.wait(SAID_S) == 0


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("raise RuntimeError('it ends')", ["this process ends because of an error", "RuntimeError: it ends"]),
        ("import ctypes\nctypes.string_at(0)", ["Fatal Python error: Segmentation fault"]),
        ("import os\nos.write(2, b'a C library says so\\n')", ["a C library says so"]),
        ("print('half a line', end='')", []),
        ("import warnings\nwarnings.warn('beware')", ["UserWarning: beware"]),
        ("import sys\nsys.exit('a reason')", ["a reason"]),
    ],
)
def test_what_the_interpreter_says_arrives(children: list[Child], code: str, words: list[str]) -> None:
    child = Child(code)
    children.append(child)
    output = child.output.read().decode()
    child.process.wait(WAIT_S)
    for word in words:
        assert word in output


def test_a_log_of_ones_own_is_text(children: list[Child]) -> None:
    child = Child("import logging\nlogging.getLogger('cobot').info('said\\nso')", supervised=False)
    children.append(child)
    (line,) = child.lines()
    assert line.decode().endswith(" INFO child: said\\nso\n")


SUPERVISOR = """
import logging, pathlib, sys, time
from cobot.config import LoggingSection
from cobot.logs.supervision import LOSSES, SupervisorLosses, supervising
path = pathlib.Path(sys.argv[1])
with supervising(LoggingSection(format=sys.argv[2], level="info"), path) as made:
    begun = time.monotonic()
    for n in range(10000):
        logging.getLogger("cobot").info("%06d %s", n, "x" * 100)
    assert time.monotonic() - begun < 15.0
    if path.name == "full":
        made._file.wait(10.0)
    print(*SupervisorLosses(made.losses).read(), file=sys.stderr, flush=True)
print("ended", file=sys.stderr)
"""


def supervise(path: Path, stdout: Any, form: str = "text") -> subprocess.Popen[str]:
    command = [sys.executable, "-c", SUPERVISOR, str(path), form]
    return subprocess.Popen(
        command, stdout=stdout, stderr=subprocess.PIPE, text=True, env=dict(HELPER_ENVIRONMENT)
    )


def test_a_full_disk_costs_lines_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "full").symlink_to("/dev/full")
    process = supervise(tmp_path / "full", subprocess.DEVNULL)
    _, said = process.communicate(timeout=WAIT_S)
    assert process.returncode == 0, said
    file, _, error = map(int, said.split()[:3])
    assert file == 10_000
    assert os.strerror(error) == "No space left on device"


def test_a_terminal_that_takes_nothing_keeps_no_line_from_the_file(tmp_path: Path) -> None:
    """Nor does it keep the supervisor from its end."""
    path = tmp_path / "a.log"
    process = supervise(path, subprocess.PIPE, "json")
    assert process.wait(WAIT_S) == 0
    assert process.stderr is not None
    file, terminal, error = map(int, process.stderr.readline().split())
    assert (terminal > 0, error) == (True, 0)
    sent = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    assert len([each for each in sent if each["message"][:6].isdigit()]) == 10_000 - file
    assert process.stdout is not None
    process.stdout.close()
    process.stderr.close()


def test_a_stopped_terminal_stops_nobody(tmp_path: Path) -> None:
    """Ctrl-S, and a pseudo-terminal that nobody reads."""
    master, terminal = pty.openpty()
    process = supervise(tmp_path / "a.log", terminal)
    os.close(terminal)
    assert process.wait(WAIT_S) == 0
    os.close(master)
    assert process.stderr is not None
    process.stderr.close()
