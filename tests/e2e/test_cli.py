"""The commands that use a running service, at one.

Oracles: what REST says about the same arm; bash, which reads the completion.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
import pytest
from cobot_run import WAIT_S, Run, until

from cobot.launch.cli import main

WORK = [0.0, 0.5, 0.0, -1.2, 0.0, 1.4, 0.0]
CSV = "time," + ",".join(f"joint{number}" for number in range(1, 8))


class Shell:
    """Commands at the shared service, in this process."""

    def __init__(self, run: Run, capsys: pytest.CaptureFixture[str]) -> None:
        self.run, self._capsys = run, capsys

    def __call__(self, *words: str) -> tuple[int, str, str]:
        status = main([*words, "--url", self.run.url])
        captured = self._capsys.readouterr()
        return status, captured.out, captured.err

    def json(self, *words: str) -> Any:
        status, out, err = self(*words, "--json")
        assert status == 0, out + err
        return json.loads(out)


@pytest.fixture
def shell(shared: Run, capsys: pytest.CaptureFixture[str]) -> Shell:
    shared.go_home()
    capsys.readouterr()
    return Shell(shared, capsys)


def test_the_state_is_shown_to_people_and_to_programs(shell: Shell) -> None:
    status, out, _ = shell("state")
    assert status == 0
    assert f"{shell.run.name}: HOLD" in out
    assert "joint7" in out
    assert "TCP in base_link: x 0.4" in out
    assert "control: free" in out
    found = shell.json("state")
    assert found["joints"]["position"] == pytest.approx(shell.run.joints(), abs=1e-3)
    assert found["robot"]["mode"] == "HOLD"


@pytest.mark.parametrize(
    "goal",
    [
        ["work"],
        ["-0.1", "0.5", "0", "-1.2", "0", "1.4", "1e-3"],
        ["pose", "0.45", "-0.1", "0.5", "0", "3.14159", "0"],
        ["pose", "0.45", "0", "0.5", "0", "3.14159", "0", "--planner", "lin"],
    ],
    ids=["name", "joints", "pose", "line"],
)
def test_a_move_ends_when_the_arm_has_arrived(shell: Shell, goal: list[str]) -> None:
    before = shell.run.joints()
    assert shell.json("move", *goal, "--speed", "0.5")["success"] is True
    assert shell.run.joints() != pytest.approx(before, abs=0.01)
    status, out, _ = shell("move", "home", "--speed", "1")
    assert (status, out.startswith("arrived after ")) == (0, True)


def test_moves_are_queued_and_followed_as_jobs(shell: Shell) -> None:
    override = f"{shell.run.url}/robot/speed_override"
    httpx.post(override, json={"fraction": 0.0}, timeout=WAIT_S).raise_for_status()  # until both are queued
    first = shell.json("move", "work", "--speed", "0.5", "--queue", "--blend-radius", "0.05")
    status, out, _ = shell("move", "0.1", "0.5", "0", "-1.2", "0", "1.4", "0", "--queue")
    assert (status, out.startswith("job ")) == (0, True)
    job = out.split()[1]
    httpx.post(override, json={"fraction": 1.0}, timeout=WAIT_S).raise_for_status()
    assert first["parent"] == shell.json("jobs", job)["parent"] is not None
    until(lambda: shell.json("jobs", job)["state"] == "finished")
    assert shell.json("jobs", first["id"])["state"] == "finished"
    status, _, err = shell("move", "home", "--blend-radius", "0.1")
    assert (status, "--queue" in err) == (1, True)


def test_what_the_service_refuses_is_said_in_its_words_with_status_1(shell: Shell) -> None:
    asked = httpx.post(f"{shell.run.url}/robot/move/named", json={"name": "nowhere"}, timeout=WAIT_S).json()
    status, out, err = shell("move", "nowhere")
    assert (status, out, err) == (1, "", f"cobot: {asked['detail']}\n")
    status, out, _ = shell("move", "nowhere", "--json")
    assert status == 1
    assert json.loads(out) == {"success": False, "code": asked["code"], "message": asked["detail"]}
    for words, part in (
        (["move", "1", "x"], "'x' is not a number"),
        (["move", "pose", "1", "2"], "X Y Z, or X Y Z A B C; got 2 numbers"),
        (["move", "0", "0"], "joints must have 7 angles, got 2"),
        (["send", "/nonexistent.csv"], "/nonexistent.csv: No such file"),
        (["run", "/nonexistent.json"], "/nonexistent.json: No such file"),
        (["watch", "--types", "moed"], "'moed' is not an event type"),
        (["watch", "--state-hz", "nan"], "state_hz: "),
        (["state", "--robot", "nobody"], "there is no robot 'nobody'"),
    ):
        status, _, err = shell(*words)
        assert (status, part in err) == (1, True), err


def test_nobody_there_is_status_3(capsys: pytest.CaptureFixture[str]) -> None:
    for command in (["state"], ["move", "home"], ["watch"], ["stop"]):
        assert main([*command, "--url", "http://127.0.0.1:9"]) == 3
        assert capsys.readouterr().err.startswith("cobot: ")


def test_a_trajectory_is_sent_and_waited_for(shell: Shell, tmp_path: Path) -> None:
    home = shell.run.joints()
    points = [{"positions": home, "time_from_start": 0.0}, {"positions": WORK, "time_from_start": 3.0}]
    as_json, as_csv, bad = (tmp_path / name for name in ("there.json", "back.csv", "bad.json"))
    as_json.write_text(json.dumps({"points": points}), encoding="utf-8")
    rows = [[0.0, *WORK], [3.0, *home]]
    as_csv.write_text("\n".join([CSV, *(",".join(map(str, row)) for row in rows)]), encoding="utf-8")
    bad.write_text('{"points": ', encoding="utf-8")
    sent = shell.json("send", str(as_json), "--move-to-start")
    assert (sent["status"], sent["result"]) == ("sent", "ARRIVED")
    assert shell.run.joints() == pytest.approx(WORK, abs=0.01)
    status, out, err = shell("send", str(as_csv), "--move-to-start")
    assert (status, "has reached its goal" in out) == (0, True), err
    assert shell.run.joints() == pytest.approx(home, abs=0.01)
    status, _, err = shell("send", str(bad))
    assert (status, "is not valid JSON" in err) == (1, True)


def test_a_sequence_is_run_at_the_service(shell: Shell, tmp_path: Path) -> None:
    program, wrong = tmp_path / "program.lua", tmp_path / "wrong.json"
    program.write_text('print("hello")\n', encoding="utf-8")
    wrong.write_text("{}", encoding="utf-8")
    assert shell.json("run", str(program), "--iterations", "2")["returncode"] == 0
    assert shell("run", str(program)) == (0, "hello\nprogram.lua is done\n", "")
    status, _, err = shell("run", str(wrong))
    assert (status, "wrong.json ended with return code" in err) == (1, True)


def test_a_stop_goes_through_the_service_of_an_address(shell: Shell) -> None:
    status, out, _ = shell("stop")
    assert (status, out) == (0, "nothing was running; the arm is at rest\n")
    assert shell.json("stop")["at_rest"] is True


def test_watch_prints_what_happens(shell: Shell) -> None:
    command = [sys.executable, "-m", "cobot", "watch", "--json", "--url", shell.run.url]
    command += ["--types", "stop", "--count", "2", "--after", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as watching:
        shell("stop")
        shell("stop")
        assert watching.stdout is not None
        lines = [json.loads(line) for line in watching.stdout]
        assert watching.wait(WAIT_S) == 0
    assert [each["type"] for each in lines] == ["stop", "stop"]
    status, out, _ = shell("watch", "--after", "0", "--types", "service", "--count", "1")
    assert status == 0
    assert " - service what=started " in out


def test_jobs_without_an_id_cannot_be_changed(shell: Shell) -> None:
    status, _, err = shell("jobs", "--cancel")
    assert (status, err) == (1, "cobot: --cancel: needs the ID of a job\n")


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["run", "--url", "http://localhost:1"], "run: --url needs a SEQUENCE"),
        (["run", "--json"], "run: --json needs a SEQUENCE"),
        (["run", "a.json", "--port", "1"], "run: --port cannot be used with a SEQUENCE"),
        (["run", "a.json", "--iterations", "0"], "'0' is not a number from 1 to 1000000"),
        (["stop", "--json"], "stop: --token, --certificate and --json need --url"),
        (["stop", "--estop", "--url", "http://localhost:1"], "cannot be used with --url"),
        (["move"], "GOAL"),
    ],
)
def test_what_makes_no_sense_together_is_status_2(
    words: list[str], part: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert part in capsys.readouterr().err


def test_bash_completes_commands_and_their_options(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    bash = shutil.which("bash")
    assert bash is not None

    def completed(*words: str) -> set[str]:
        ask = f'COMP_WORDS=({" ".join(words)}); COMP_CWORD={len(words) - 1}; _cobot; echo "${{COMPREPLY[@]}}"'
        found = subprocess.run([bash, "-c", f"{script}\n{ask}"], capture_output=True, text=True, check=True)
        return set(found.stdout.split())

    assert completed("cobot", "mo") == {"move", "moveit-config"}
    assert completed("cobot", "watch", "--st") == {"--state-hz"}
    assert {"create", "list", "revoke"} <= completed("cobot", "token", '""')
    for shell in ("zsh", "fish"):
        assert main(["completion", shell]) == 0
        assert "--state-hz" in (text := capsys.readouterr().out) or "-l state-hz" in text


def test_a_stop_of_category_1_switches_the_drives_off_until_a_reset(shell: Shell) -> None:
    stopped = shell.json("stop", "--category", "1")
    assert (stopped["success"], stopped["category"]) == (True, 1)
    assert shell.json("state")["robot"]["mode"] == "ESTOP"
    httpx.post(f"{shell.run.url}/robot/reset", timeout=WAIT_S).raise_for_status()
    assert shell.json("stop")["category"] == 2
    assert shell.json("state")["robot"]["mode"] == "HOLD"


def test_a_stop_of_another_category_or_without_a_service_is_wrong_usage(shell: Shell) -> None:
    for words in (["stop", "--category", "0", "--url", shell.run.url], ["stop", "--category", "1"]):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 2


def test_there_is_nothing_to_acknowledge_of_a_simulation(shell: Shell) -> None:
    """With hardware: tests/app/api/routers/test_robots.py has what is found."""
    status, out, err = shell("acknowledge", "--payload-checked")
    assert status == 0, err
    assert "nothing to acknowledge" in out


def test_programs_are_stored_shown_and_run(shell: Shell, tmp_path: Path) -> None:
    """Oracle: the file that was saved; the process that runs it ends with 0."""
    file = tmp_path / "kiste.json"
    file.write_text('{"waypoints": [{"named": "home", "speed": 1.0}]}', encoding="utf-8")
    saved = shell("program", "save", "kiste", str(file), "--label", "Über Kiste 1")
    assert (saved[0], saved[1]) == (0, "program kiste is saved as version 1\n")
    assert shell("program", "show", "kiste")[1] == file.read_text(encoding="utf-8") + "\n"
    assert "Über Kiste 1" in shell("program", "list")[1]
    file.write_text('{"waypoints": [{"named": "work"}]}', encoding="utf-8")
    refused = shell("program", "save", "kiste", str(file))
    assert refused[0] == 1
    assert "saved version 1" in refused[2]
    assert shell("program", "save", "kiste", str(file), "--base", "1")[0] == 0
    assert shell("program", "run", "kiste", "--version", "1")[0] == 0
    for words in (("show",), ("save", "kiste"), ("run", "none")):
        assert shell("program", *words)[0] == 1, words
    address = f"{shell.run.url}/sequences/status"
    until(lambda: httpx.get(address, timeout=WAIT_S).json()["returncode"] == 0)
    httpx.delete(f"{shell.run.url}/programs/kiste", timeout=WAIT_S).raise_for_status()
