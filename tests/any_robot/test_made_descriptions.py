"""Descriptions drawn at random, in every spelling: one of each kind is converted.

Oracle: the number of joints and the mass of the links that the generator wrote. `python -m benchmarks corpus`
converts and moves all of them.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.corpus.made import KINDS, made_descriptions
from cobot.config import load_settings
from cobot.launch.cli import main
from cobot.robot.description import load_robot

STRIDE = len(KINDS) + 1
"""Takes the kinds in turn, and with each the next spelling of the file."""


@pytest.mark.parametrize("number", range(0, STRIDE * len(KINDS), STRIDE))
def test_a_random_description_is_converted(tmp_path: Path, number: int) -> None:
    description = list(made_descriptions(tmp_path / "files", number + 1))[number]
    folder = tmp_path / "robot"
    assert main(["new-robot", str(description.file), "--output", str(folder)]) == 0
    robot = load_robot(load_settings(folder / "cobot-setting.yaml"))
    content = description.file.read_bytes()
    text = content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "latin-1")
    assert robot.limits.dof == len(KINDS[description.file.stem.rpartition("_")[0]])
    stated = dict(re.findall(r'<link name="(link\d)"><inertial><origin [^>]*/><mass value="([^"]+)"', text))
    for link, mass in stated.items():
        assert robot.model.mj.body(link).mass[0] == pytest.approx(float(mass), rel=1e-4)
    assert len(stated) >= 1
