"""The package for MoveIt 2. Oracles: pinocchio's readers of URDF and SRDF, PyYAML, the action that cobot has.

MoveIt itself is not here: what it makes of the files is not tested.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest
import yaml

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.launch.cli import main
from cobot.launch.moveit import moveit_files, write_moveit_config
from cobot.robot.description import RobotDescription

SEED = 20


@pytest.fixture(scope="module")
def files(settings: Settings) -> dict[str, str]:
    return moveit_files(settings)


def test_named_positions_are_those_of_the_service(files: dict[str, str], robot: RobotDescription) -> None:
    model = pinocchio.buildModelFromXML(files["config/iiwa.urdf"])
    pinocchio.loadReferenceConfigurationsFromXML(model, files["config/iiwa.srdf"])
    states = ElementTree.fromstring(files["config/iiwa.srdf"]).iter("group_state")
    read = {each.attrib["name"]: list(model.referenceConfigurations[each.attrib["name"]]) for each in states}
    assert read == {name: list(position.joints) for name, position in robot.positions.items()}


def test_links_collide_where_the_service_says_so(files: dict[str, str], robot: RobotDescription) -> None:
    description = files["config/iiwa.urdf"]
    model = pinocchio.buildModelFromXML(description)
    shapes = pinocchio.buildGeomFromUrdfString(model, description, pinocchio.COLLISION)
    shapes.addAllCollisionPairs()
    before = len(shapes.collisionPairs)
    pinocchio.removeCollisionPairsFromXML(model, shapes, files["config/iiwa.srdf"])
    assert 0 < len(shapes.collisionPairs) < before
    data, found = model.createData(), shapes.createData()
    random = np.random.default_rng(SEED)
    # Near the ends of the joints, where the arm is folded onto itself.
    ends = np.where(random.random((300, model.nq)) < 0.5, model.lowerPositionLimit, model.upperPositionLimit)
    collided = []
    for joints in ends * random.uniform(0.85, 1.0, ends.shape):
        contacts = robot.collision.contacts(joints)
        distances = [each.distance_m for each in contacts if "floor" not in (each.first, each.second)]
        if distances and abs(min(distances)) < 0.002:
            continue  # a hair's breadth is a matter of the library
        touches = pinocchio.computeCollisions(model, data, shapes, found, joints, True)
        collided.append(touches)
        assert touches == (bool(distances) and min(distances) < 0.0), f"seed {SEED}: {joints.tolist()}"
    assert 10 < sum(collided) < 290


def test_the_controller_is_the_action_that_cobot_has(files: dict[str, str], settings: Settings) -> None:
    config = yaml.safe_load(files["config/moveit_controllers.yaml"])["moveit_simple_controller_manager"]
    (controller,) = config["controller_names"]
    assert f"/{controller}/{config[controller]['action_ns']}" == "/iiwa/follow_joint_trajectory"
    srdf = ElementTree.fromstring(files["config/iiwa.srdf"])
    urdf = ElementTree.fromstring(files["config/iiwa.urdf"])
    assert srdf.attrib["name"] == urdf.attrib["name"]
    joints = [each.attrib["name"] for each in urdf.iter("joint") if each.attrib.get("type") == "revolute"]
    assert config[controller]["joints"] == joints
    limits = yaml.safe_load(files["config/joint_limits.yaml"])["joint_limits"]
    shipped = yaml.safe_load(settings.web.joint_limits.read_text(encoding="utf-8"))["joint_limits"]
    assert list(limits) == joints
    for name, limit in limits.items():
        assert limit.items() <= shipped[name].items()
    (group,) = yaml.safe_load(files["config/kinematics.yaml"])
    assert group == srdf.find("group").attrib["name"]  # type: ignore[union-attr]
    for release in ("", "_humble"):
        assert group in yaml.safe_load(files[f"config/ompl_planning{release}.yaml"])["ompl"]


def test_the_command_writes_the_package_once(
    settings: Settings, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["moveit-config", str(tmp_path)]) == 0
    made = Path(capsys.readouterr().out.strip())
    assert made == tmp_path / "iiwa_moveit_config"
    compile((made / "launch/moveit.launch.py").read_text(encoding="utf-8"), "moveit.launch.py", "exec")
    with pytest.raises(ConfigError, match="exists"):
        write_moveit_config(settings, tmp_path)
