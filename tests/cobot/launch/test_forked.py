"""Processes that are forked. Oracles: the process table, and what a process says of itself."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from cobot_run import until

TOLD = """
import json, os, psutil, sys
if sys.argv[-1] == "again":
    from cobot.launch.forked import fork_processes
    from cobot.launch.process import RUN_MODULE
    (blank,) = fork_processes(1)
    numbers = [int(sys.argv[1])]
    assert blank.become([*RUN_MODULE, "told", *sys.argv[1:-1]], 2, numbers, {"OF_ITS_OWN": "a value"})
    raise SystemExit(blank.wait(60.0))
here = psutil.Process()
numbers = sorted(int(name) for name in os.listdir("/proc/self/fd"))
told = {
    "name": __name__, "arguments": sys.argv[1:], "command": here.cmdline(), "path": sys.path,
    "variable": os.environ["OF_ITS_OWN"], "session": os.getsid(0), "pid": here.pid,
    "input": os.readlink("/proc/self/fd/0"),
    "numbers": [number for number in numbers if os.path.exists(f"/proc/self/fd/{number}")],
}
os.write(int(sys.argv[1]), json.dumps(told).encode())
raise SystemExit(3)
"""
STARTER = """
import json, os, signal, sys, time
from cobot.launch.forked import fork_processes
from cobot.launch.process import RUN_MODULE
signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # as who has started us may have it
os.dup2(1, 200, inheritable=True)
first, second = fork_processes(2)
print(first.pid, second.pid, flush=True)
if sys.argv[1:] == ["wait"]:
    time.sleep(600)
reading, writing = os.pipe()
command = [*RUN_MODULE, "told", str(writing), "--a-long-option", "x" * 200]
assert first.become([*command, *sys.argv[1:]], 2, [writing], {"OF_ITS_OWN": "a value"})
os.close(writing)
with os.fdopen(reading) as pipe:
    told = json.loads(pipe.read())
status = first.wait(60.0)
second.dismiss()
first.dismiss()
print(json.dumps({"told": told, "status": status, "second": second.returncode, "number": writing,
                  "command": command}))
"""


def starter(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    (folder / "told.py").write_text(TOLD)
    environment = {"PYTHONPATH": f"{Path(__file__).parents[3]}:{folder}", "LONG": "y" * 2000}
    return subprocess.Popen(
        [sys.executable, "-c", STARTER, *arguments], stdout=subprocess.PIPE, text=True, env=environment
    )


@pytest.mark.parametrize("again", [(), ("again",)], ids=["forked", "forked by one that is forked"])
def test_it_is_the_module_as_if_python_had_begun_with_it(tmp_path: Path, again: tuple[str, ...]) -> None:
    process = starter(tmp_path, *again)
    output, _ = process.communicate(timeout=120.0)
    assert process.returncode == 0
    _, said = output.splitlines()
    found = json.loads(said)
    told = found["told"]
    assert told["name"] == "__main__"
    assert told["arguments"] == found["command"][4:]
    assert [part for part in told["command"] if part] == found["command"]  # spaces may follow
    assert told["variable"] == "a value"
    assert told["session"] == told["pid"]
    assert told["input"] == "/dev/null"
    assert told["numbers"] == [0, 1, 2, found["number"]]
    assert "" not in told["path"]
    assert found["status"] == 3
    assert found["second"] == 0


def test_those_that_wait_end_with_who_has_forked_them(tmp_path: Path) -> None:
    process = starter(tmp_path, "wait")
    assert process.stdout is not None
    with process.stdout:
        pids = [int(pid) for pid in process.stdout.readline().split()]
    assert all(psutil.pid_exists(pid) for pid in pids)
    process.kill()
    process.wait()
    until(lambda: not any(psutil.pid_exists(pid) for pid in pids))
