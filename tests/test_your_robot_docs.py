"""docs/your-robot.md: its commands are run as they stand there, and say what it shows. Oracle: the page."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from cobot_run import RunOfFolder
from folders import ROOT

PAGE = ROOT / "docs" / "your-robot.md"
SERVICE = "http://localhost:8007"


def blocks() -> list[tuple[str, list[str]]]:
    """(language, lines) of each block of the page; what is printed has no language."""
    found = re.findall(r"^```(\w*)\n(.*?)\n```$", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    return [(language, text.splitlines()) for language, text in found]


class Walk:
    """A terminal at the top of a checkout, and the robot that runs in another one."""

    def __init__(self, place: Path) -> None:
        self.place, self.run = place, None
        (place / "examples").symlink_to(ROOT / "examples")
        (place / "bin").mkdir()
        cobot = place / "bin" / "cobot"
        cobot.write_text(f'#!/bin/sh\nexec {sys.executable} -m cobot "$@"\n')
        cobot.chmod(0o755)
        self._environment = os.environ | {
            "PATH": f"{cobot.parent}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
            "XDG_STATE_HOME": str(place / "state"),
            "no_proxy": "*",
        }

    def type(self, command: str) -> str:
        """What it prints."""
        if command.startswith("cobot run --config "):
            self.run = RunOfFolder(self.place / command.split()[-1])
            self.run.until(self.run.healthy)
            return ""
        if self.run is not None:
            command = command.replace(SERVICE, self.run.url)
        ended = subprocess.run(
            ["bash", "-c", command], cwd=self.place, env=self._environment, capture_output=True, text=True,
            timeout=120, check=False,
        )  # fmt: skip
        said = ended.stdout + ended.stderr
        if command.startswith("curl "):
            assert json.loads(ended.stdout)["success"], (command, said)
        elif command.startswith("cobot stop"):
            assert ended.returncode == 0, (command, said)
        return said


@pytest.mark.thorough
def test_each_command_of_the_page_does_what_the_page_shows(tmp_path: Path) -> None:
    walk, said, commands = Walk(tmp_path), "", []
    try:
        for language, lines in blocks():
            if language == "sh":
                commands += lines
                said = "\n".join(map(walk.type, lines))
            else:
                assert [line for line in lines if line not in said] == [], said
        assert walk.run is not None, "the page does not run the robot"
        assert [line.split()[1] for line in commands if line.startswith("cobot ")] == [
            "new-robot", "check", "check", "run", "stop",
        ]  # fmt: skip
    finally:
        if walk.run is not None:
            walk.run.process.terminate()
            walk.run.process.wait(30.0)
