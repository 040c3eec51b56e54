"""Forces of an MJCF file that plans do not know. Oracle: MuJoCo, which computes what acts at rest."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cobot.config import load_settings
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.robot.description import load_robot

POSTURE = (0.7, -0.5)
ARM = """<mujoco><compiler angle="radian"/><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body name="base" pos="0 0 .3"><geom size=".03"/><body name="one" pos="0 0 .2">
<joint name="j" axis="0 1 0" range="-1 1"/><geom type="capsule" size=".02" fromto="0 0 .05 0 0 .2"/>
<body name="two" pos="0 0 .3"><joint name="k" axis="0 1 0" range="-1 1"/>
<geom type="capsule" size=".02" fromto="0 0 .05 0 0 .2"/><site name="tcp" pos="0 0 .2"/></body></body></body>
</worldbody></mujoco>"""
TENDON = (
    '<tendon><fixed name="t" stiffness="9"><joint joint="j" coef="1"/><joint joint="k" coef="1"/></fixed>'
    "</tendon></mujoco>"
)
FORCES = {
    "springs": ('<joint name="j"', '<joint stiffness="9" name="j"', "springs of the file removed, .*: j"),
    "defaults": ("<worldbody>", '<default><joint stiffness="9"/></default><worldbody>', "springs .*: j, k"),
    "tendon": ("</mujoco>", TENDON, "tendons of the file removed, .*: t"),
    "gravcomp": ('<body name="two"', '<body gravcomp="1" name="two"', r"\(gravcomp\) of the file rem.*: two"),
    "joints": ('<joint name="j"', '<joint margin="0.5" name="j"', "margins of joint limits .*: j"),
    "contacts": (
        "<worldbody>",
        '<default><geom margin="2"/></default><worldbody>',
        "margins of contacts in the file are set to 0",
    ),
    "override": (
        "<worldbody>",
        '<option o_margin="2"><flag override="enable"/></option><worldbody>',
        "margins of contacts in the file are set to 0",
    ),
    "medium": ("<worldbody>", '<option density="9" wind="5 0 0"/><worldbody>', "the medium of the file"),
}


def pushed(model: mujoco.MjModel) -> float:
    """The largest torque on the resting arm besides gravity."""
    data = mujoco.MjData(model)
    data.qpos[:] = POSTURE
    mujoco.mj_forward(model, data)
    return float(np.abs(data.qfrc_passive + data.qfrc_constraint).max())


@pytest.mark.parametrize("kind", sorted(FORCES))
def test_a_force_that_plans_do_not_know_is_removed_and_reported(kind: str, tmp_path: Path) -> None:
    old, new, sentence = FORCES[kind]
    text = ARM.replace(old, new, 1)
    assert pushed(mujoco.MjModel.from_xml_string(text)) > 0.01
    file = tmp_path / "arm.xml"
    file.write_text(text)
    robot = NewRobot(file)
    robot.write(tmp_path / "made")
    made = load_robot(load_settings(tmp_path / "made" / "cobot-setting.yaml"))
    assert pushed(made.model.mj) == 0.0
    said = [each for each in robot.guessed if "file" in each and ("remove" in each or "margins" in each)]
    assert len(said) == 1
    assert re.search(sentence, said[0])
