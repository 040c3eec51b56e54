"""xacro as makers write it. Oracle: the values that the test has put into macros, arguments and YAML."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from cobot.launch.cli import main

ARM = """<?xml version="1.0"?>
<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="reach" default="0.4"/>
  <xacro:arg name="model" default="none"/>
  <xacro:include filename="$(find arm_description)/urdf/macros.xacro"/>
  <xacro:property name="file" value="$(find arm_description)/config/$(arg model).yaml"/>
  <xacro:property name="limits" value="${xacro.load_yaml(file)}"/>
  <link name="base"/>
  <xacro:turning number="1" parent="base" axis="0 0 1" length="$(arg reach)"/>
  <xacro:turning number="2" parent="link1" axis="0 1 0" length="${0.5 * 0.4}"/>
</robot>
"""
MACROS = """<?xml version="1.0"?>
<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="turning" params="number parent axis length">
    <link name="link${number}">
      <inertial><origin xyz="0 0 ${length / 2}"/><mass value="2"/>
        <inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
      <collision><origin xyz="0 0 ${length / 2}"/>
        <geometry><mesh filename="package://arm_description/meshes/tube.stl"/></geometry></collision>
    </link>
    <joint name="joint${number}" type="revolute">
      <origin xyz="0 0 ${length}"/><parent link="${parent}"/><child link="link${number}"/>
      <axis xyz="${axis}"/>
      <limit lower="-2" upper="2" velocity="${limits['velocity']}" effort="40"/>
    </joint>
  </xacro:macro>
</robot>
"""
TUBE = """solid tube
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex 0.02 0 0
vertex 0 0.02 0
endloop
endfacet
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex 0 0.02 0
vertex 0 0 0.05
endloop
endfacet
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex 0 0 0.05
vertex 0.02 0 0
endloop
endfacet
facet normal 0 0 0
outer loop
vertex 0.02 0 0
vertex 0 0 0.05
vertex 0 0.02 0
endloop
endfacet
endsolid tube
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A package as it is cloned: its folder has the repository's name, its manifest the package's."""
    package = tmp_path / "Arm_ROS2_Description"
    contents = {
        "package.xml": "<package format='3'><name>arm_description</name></package>",
        "urdf/arm.urdf.xacro": ARM,
        "urdf/macros.xacro": MACROS,
        "config/long.yaml": "velocity: 1.25\n",
        "meshes/tube.stl": TUBE,
    }
    for name, content in contents.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(content)
    return package / "urdf" / "arm.urdf.xacro"


def make(file: Path, *options: str) -> tuple[int, Path]:
    folder = file.parents[2] / "made"
    return main(["new-robot", str(file), "--output", str(folder), *options]), folder


def test_a_package_is_found_by_its_manifest_and_arguments_and_yaml_count(file: Path) -> None:
    status, folder = make(file, "--xacro", "model:=long", "reach:=0.7")
    assert status == 0
    model = ElementTree.parse(folder / "model.xml").getroot()
    places = {body.get("name"): body.get("pos") for body in model.iter("body")}
    assert places["link1"] == "0.0 0.0 0.7"
    assert places["link2"] == "0.0 0.0 0.2"
    assert "max_velocity: 1.25" in (folder / "joint_limits.yaml").read_text()


def test_an_error_lists_the_arguments_that_the_file_declares(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, folder = make(file)
    assert status == 1
    said = capsys.readouterr().err
    assert "none.yaml" in said
    assert "its arguments are: reach, model; set them with --xacro NAME:=VALUE" in said
    assert not folder.exists()


def test_errors_of_the_expanded_file_say_that_they_are(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file.write_text(file.read_text().replace('<link name="base"/>', '<link name="base"/><link name="base"/>'))
    status, _ = make(file, "--xacro", "model:=long")
    assert status == 1
    assert "arm.urdf.xacro (expanded):" in capsys.readouterr().err


def test_a_package_that_is_not_there_is_named_with_the_way_out(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file.write_text(file.read_text().replace("find arm_description)/config", "find arm_config)/config"))
    status, _ = make(file, "--xacro", "model:=long")
    assert status == 1
    assert "there is no package 'arm_config'" in capsys.readouterr().err
    other = file.parents[2] / "elsewhere" / "arm_config" / "config"
    other.mkdir(parents=True)
    (other / "long.yaml").write_text("velocity: 1.5\n")
    status, folder = make(file, "--xacro", "model:=long", "--package", str(other.parents[1]))
    assert status == 0
    assert "max_velocity: 1.5" in (folder / "joint_limits.yaml").read_text()


@pytest.mark.parametrize(
    "hostile",
    [
        "${[0] * 10**12}",
        "${().__class__.__bases__[0].__subclasses__()}",
        '<xacro:include filename="/dev/zero"/>',
        "<xacro:macro name='m'><xacro:m/></xacro:macro><xacro:m/>",
        "${undefined_thing}",
        "$(find)",
    ],
)
def test_a_hostile_file_ends_with_a_sentence(
    file: Path, capsys: pytest.CaptureFixture[str], hostile: str
) -> None:
    where, text = ("<link", f"{hostile}<link") if hostile.startswith("<") else ("0 0 1", hostile)
    file.write_text(file.read_text().replace(where, text, 1))
    status, folder = make(file, "--xacro", "model:=long")
    assert status == 1
    said = capsys.readouterr().err
    assert said.startswith(f"cobot: {file}")
    assert "Traceback" not in said
    assert not folder.exists()


def test_arguments_of_a_file_that_is_not_xacro_are_rejected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.urdf").write_text('<robot name="arm"><link name="base"/></robot>')
    assert main(["new-robot", str(tmp_path / "arm.urdf"), "--xacro", "a:=b"]) == 1
    assert "is not xacro, so --xacro has no effect" in capsys.readouterr().err
