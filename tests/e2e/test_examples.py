"""Each example, as its own header says how to run it, against a running service."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import tree_sitter
import tree_sitter_matlab
from cobot_run import Run
from thorough import few

from cobot.client import Client

EXAMPLES = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(
    path.name for path in EXAMPLES.iterdir() if path.is_file() and path.suffix not in (".csv", ".json")
)
STARTS = ("make run", "make setup-test")
"""They are run already: the shared service, and the environment of the tests."""
COMMAND = re.compile(r"^(?:#|--|%)? *((?:make|bash|run|\.venv/bin/\w+) .*)$", re.M)


def commands(script: str) -> list[str]:
    """The command lines of a header: what comes before the first line of the program."""
    header = re.split(r"\n(?:from|local|set|URL|robots)\b", (EXAMPLES / script).read_text(encoding="utf-8"))[
        0
    ]
    said = ("make run", "cobot run", "Nothing has to run")
    assert any(each in header for each in said), f"{script} does not say what has to run"
    return [command for command in COMMAND.findall(header) if command not in STARTS]


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A folder in which the commands can be typed as they stand."""
    (tmp_path / "examples").symlink_to(EXAMPLES)
    (tmp_path / ".venv").symlink_to(sys.prefix)
    return tmp_path


def output(clone: Path, command: str, run: Run) -> str:
    """What a command prints, at the shared service instead of that of `make run`."""
    ended = subprocess.run(
        ["bash", "-c", command],
        cwd=clone,
        env={
            **os.environ,
            "COBOT_URL": run.url,
            "COBOT_ROBOT": run.name,
            "http_proxy": "http://127.0.0.1:9",
        },
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def test_every_example_says_how_it_is_run() -> None:
    assert {script: commands(script)[-1] for script in SCRIPTS} == {
        "hello.lua": ".venv/bin/cobot lua examples/hello.lua",
        "learning_env.py": ".venv/bin/python examples/learning_env.py",
        "lerobot_arm.py": ".venv/bin/python examples/lerobot_arm.py",
        "new_goal.py": ".venv/bin/python examples/new_goal.py",
        "openpi_policy.py": ".venv/bin/python examples/openpi_policy.py HOST:PORT [SECONDS]",
        "own_hand.py": ".venv/bin/python examples/own_hand.py",
        "paths.py": ".venv/bin/python examples/paths.py",
        "pick.lua": ".venv/bin/cobot lua examples/pick.lua",
        "plan_first.py": ".venv/bin/python examples/plan_first.py",
        "policy_30hz.py": ".venv/bin/python examples/policy_30hz.py",
        "record_and_replay.py": ".venv/bin/python examples/record_and_replay.py",
        "record_episode.py": ".venv/bin/python examples/record_episode.py",
        "scene.py": ".venv/bin/python examples/scene.py",
        "streaming_plot.py": ".venv/bin/python examples/streaming_plot.py --rate 10 --output streaming.png",
        "tour.m": "run examples/tour",
        "tour.py": ".venv/bin/python examples/tour.py",
        "tour.sh": "bash examples/tour.sh",
        "two_robots.py": ".venv/bin/python examples/two_robots.py",
        "two_robots.yaml": ".venv/bin/cobot run --config examples/two_robots.yaml",
        "upright.py": ".venv/bin/python examples/upright.py",
    }
    # This one is run beside two robots, in tests/e2e/realtime; here it is not run but checked.
    assert commands("two_robots.py")[0] == commands("two_robots.yaml")[0]


@pytest.mark.parametrize("script", few(["tour.sh", "tour.py"]))
def test_the_tour_runs_from_its_first_to_its_last_step(shared: Run, clone: Path, script: str) -> None:
    (command,) = commands(script)
    said = output(clone, command, shared)
    assert "ok" in said.splitlines()[-1] + said.splitlines()[-2]
    assert "return code 0" in said


@pytest.mark.thorough
def test_the_streaming_plot_is_drawn(shared: Run, clone: Path) -> None:
    (command,) = commands("streaming_plot.py")
    assert output(clone, f"{command} --seconds 1.5", shared) == "drawn: streaming.png\n"
    assert (clone / "streaming.png").read_bytes().startswith(b"\x89PNG\r\n")


def test_a_plan_is_looked_at_before_it_is_run(shared: Run, clone: Path) -> None:
    (command,) = commands("plan_first.py")
    said = output(clone, command, shared)
    assert "velocity: at most" in said
    assert "nearest to its surroundings" in said


@pytest.mark.thorough
def test_a_motion_gets_new_goals_while_it_runs(service: Run, clone: Path) -> None:
    (command,) = commands("new_goal.py")
    said = output(clone, command, service)
    assert said.count("new path in") == 3
    assert said.splitlines()[-1] == "joint 1 is at 0.300 rad"


def test_what_stands_in_the_way_is_gone_around(shared: Run, clone: Path) -> None:
    (command,) = commands("scene.py")
    said = output(clone, command, shared)
    assert "'version': " in said
    assert "auto used ompl (RRTConnect): ptp: collision of" in said
    assert "post" in said.splitlines()[-1]


@pytest.mark.thorough
def test_a_policy_moves_the_arm(shared: Run, clone: Path) -> None:
    (command,) = commands("policy_30hz.py")
    assert output(clone, f"{command} 0.5", shared).endswith("and rests\n")


@pytest.mark.thorough
def test_a_hand_of_ones_own_moves_the_arm_and_lets_it_rest(shared: Run, clone: Path) -> None:
    (command,) = commands("own_hand.py")
    assert "at rest at x" in output(clone, command, shared).splitlines()[-1]


@pytest.mark.thorough
def test_a_motion_is_recorded_and_done_again(shared: Run, clone: Path) -> None:
    (command,) = commands("record_and_replay.py")
    said = output(clone, command, shared).splitlines()
    assert re.search(r"[1-9]\d* of /commanded, [1-9]\d* of /cycle, [1-9]\d* of /events", said[0])
    assert re.match(r"motion \d+: \d+ points again", said[-1])
    with Client(shared.url) as client:
        work = next(each for each in client.positions() if each["name"] == "work")
    assert shared.joints() == pytest.approx(work["joints"], abs=5e-3)


@pytest.mark.parametrize("script", few(["hello.lua", "pick.lua"]))
def test_a_lua_program_runs(shared: Run, clone: Path, script: str) -> None:
    (command,) = commands(script)
    assert output(clone, f"{command} --url {shared.url}", shared).endswith("done\n")


def test_the_settings_of_two_robots_are_valid(shared: Run, clone: Path) -> None:
    (command,) = commands("two_robots.yaml")
    assert output(clone, command.replace("cobot run", "cobot check"), shared)


def test_the_matlab_tour_is_matlab() -> None:
    """Oracle: the MATLAB grammar of tree-sitter. It does not run here: webwrite is MATLAB's own."""
    parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_matlab.language()))
    source = (EXAMPLES / "tour.m").read_bytes()
    assert not parser.parse(source).root_node.has_error
    assert parser.parse(source.replace(b"webread([", b"webread([(", 1)).root_node.has_error
