"""What `cobot new-robot` accepts and rejects of a file. Oracles: the formats (XML 1.0, URDF), numbers and
lines that the tests write, and files broken at random with a fixed seed.
"""

from __future__ import annotations

import codecs
import shlex
from pathlib import Path

import mujoco
import pytest
import yaml
from thorough import few
from urdf_arms import ARMS, urdf

from benchmarks.corpus.fuzz import broken_files, judge, sources
from cobot.errors import ConfigError
from cobot.launch.cli import main
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.launch.robot_file.mjcf_checks import check_mjcf
from cobot.launch.robot_file.urdf_checks import check_urdf
from cobot.robot.file_limits import urdf_rates
from cobot.xml_file import parse

ARM = urdf(ARMS["ur"])
LINES = ARM.replace("<link", "\n<link").replace("<joint", "\n<joint")
"""A line for each link and joint."""


def line_of(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1


def checked(file: Path) -> None:
    root, _ = parse(file)
    check_urdf(file, root)
    urdf_rates(file, root)


@pytest.mark.parametrize(
    ("encoding", "name", "mark"),
    [
        ("ISO-8859-1", "Gelenk_ä", b""),
        ("windows-1252", "Gelenk_€", b""),
        ("GBK", "关节", b""),
        ("Shift_JIS", "関節", b""),
        ("UTF-8", "关节", codecs.BOM_UTF8),
        ("UTF-16-LE", "关节", codecs.BOM_UTF16_LE),
        ("UTF-16-BE", "关节", codecs.BOM_UTF16_BE),
        ("UTF-16-LE", "关节", b""),
    ],
)
def test_the_declaration_and_the_byte_order_mark_decide_the_encoding(
    tmp_path: Path, encoding: str, name: str, mark: bytes
) -> None:
    declared = "UTF-16" if "16" in encoding else encoding
    text = f'<?xml version="1.0" encoding="{declared}"?>' + ARM.replace('"a0"', f'"{name}"')
    file = tmp_path / "arm.urdf"
    file.write_bytes(mark + text.encode(encoding))
    assert name in {joint.get("name") for joint in parse(file)[0].iter("joint")}


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"<robot>\n<link name='\xe4'/></robot>", r":2: is not valid utf-8 text: .*declaration name the enc"),
        (b"<?xml version='1.0' encoding='klingon'?><robot/>", "unknown encoding 'klingon'; save it as UTF-8"),
        (b"<?xml version='1.0' encoding='punycode'?><robot/>", "unknown encoding 'punycode'"),
        (b"<?xml version='1.0' encoding='zlib'?><robot/>", "unknown encoding 'zlib'"),
        (b"", ":1: is not XML: no element found"),
        (b"\n<!DOCTYPE robot [<!ENTITY a 'b'>]><robot/>", ":2: has a DOCTYPE; remove it"),
        (b"<robot>" + b"<a>" * 600, "nested more than 500 deep"),
    ],
)
def test_what_is_not_xml_is_rejected_with_the_line(tmp_path: Path, content: bytes, reason: str) -> None:
    (tmp_path / "arm.urdf").write_bytes(content)
    with pytest.raises(ConfigError, match=reason):
        parse(tmp_path / "arm.urdf")


END = ARM.count("\n") + 1
"""The line of the last element of the arm."""


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 0),
        ("</robot>", "<!-- <xacro:macro/> ${a} --></robot>", 0),
        ("</robot>", "\n<xacro:include filename='a'/></robot>", END + 1),
        ("</robot>", "\n<x:macro xmlns:x='http://ros.org/wiki/xacro'/></robot>", END + 1),
        ("</robot>", "<link name='${prefix}a'/></robot>", END),
    ],
)
def test_only_elements_and_substitutions_make_a_file_xacro(
    tmp_path: Path, old: str, new: str, line: int
) -> None:
    (tmp_path / "arm.urdf").write_text(ARM.replace(old, new, 1))
    assert parse(tmp_path / "arm.urdf")[1] == line


WRONG = {
    "duplicate joint": ('joint name="a2"', 'joint name="a1"', "joint 'a1' has the name of the joint in line"),
    "duplicate link": ('link name="link2"', 'link name="link1"', "link 'link1' has the name of the link in"),
    "no name": ('joint name="a2"', 'joint name=""', "a <joint> has no name"),
    "control character": ('joint name="a2"', 'joint name="a&#10;2"', r"has the name 'a\\n2'; give"),
    "no type": ('name="a2" type="revolute"', 'name="a2"', "joint 'a2' has no type; valid types: revolute"),
    "type": ('name="a2" type="revolute"', 'name="a2" type="hinge"', "'a2' has the type 'hinge'; valid types"),
    "two parents": ('<child link="link2"/>', '<child link="link1"/>', "'link1' is the child of two"),
    "no parent": ('<parent link="link1"/>', "", "joint 'a2': its <parent> names no link"),
    "unknown": ('<parent link="link1"/>', '<parent link="l"/>', "its <parent> is 'l', which is not a"),
    "hexadecimal": ('xyz="0.0 1.0 0.0"', 'xyz="0 -0x1 0"', "joint 'a1': xyz of <axis> is '0 -0x1 0'; it"),
    "too few": ('xyz="0.0 1.0 0.0"', 'xyz="0 1"', "'0 1'; it must be 3 decimal numbers separated by spaces"),
    "commas": ('xyz="0.0 1.0 0.0"', 'xyz="0, 1, 0"', "'0, 1, 0'; it must be 3 decimal numbers"),
    "no direction": ('xyz="0.0 1.0 0.0"', 'xyz="0 0 0"', "joint 'a1': its axis is 0 0 0; give"),
    "not a number": ('lower="-2.9"', 'lower="nan"', "joint 'a0': lower of <limit> is 'nan'"),
    "infinite": ('upper="2.9"', 'upper="1e999"', "joint 'a0': upper of <limit> is '1e999'"),
    "negative": ('velocity="1.5"', 'velocity="-1.5"', "joint 'a0': velocity is -1.5; it must be 0"),
    "radius": ('radius="0.03"', 'radius="-0.03"', "radius of <sphere> is '-0.03'; it must be above 0 m"),
    "shape": ('<sphere radius="0.03"/>', "<cone/>", "<cone> is not a shape of URDF; valid shapes: mesh, box"),
    "no shape": ('<sphere radius="0.03"/>', "", "its <collision> has no shape"),
    "origin": ('origin xyz="0 0 0.05"', 'origin xyz="0 0 2e3"', "xyz of <origin> is '0 0 2e3'; up to 1000 m"),
    "scale": ('<sphere radius="0.03"/>', '<mesh filename="a" scale="1 0 1"/>', "<mesh> must not contain 0"),
    "inertia": (' iyz="0"', "", "iyz of <inertia> is missing; give a decimal number"),
    "compiler": (
        '<link name="base_link"/>',
        '<mujoco><compiler boundinertia="nan"/></mujoco><link name="base_link"/>',
        "extension for MuJoCo: boundinertia of <compiler> is 'nan'; it must be a decimal",
    ),
    "mimic": ("<limit ", '<mimic joint="ghost"/><limit ', "mimics 'ghost', which is not a joint of"),
}  # fmt: skip


@pytest.mark.parametrize("kind", sorted(WRONG))
def test_an_error_of_a_urdf_names_the_line_and_the_joint_or_link(tmp_path: Path, kind: str) -> None:
    old, new, reason = WRONG[kind]
    assert old in LINES
    text = LINES.replace(old, new, 1)
    file = tmp_path / "arm.urdf"
    file.write_text(text)
    lines = {
        line_of(LINES, old),
        *(n for n, line in enumerate(text.split("\n"), 1) if 'link="link1"/>' in line),
    }
    with pytest.raises(ConfigError, match=reason) as said:
        checked(file)
    assert int(str(said.value).split(":")[1]) in lines


def test_loops_and_links_that_hang_on_nothing_are_named(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(ARM.replace("</robot>", '<link name="shelf"/></robot>'))
    with pytest.raises(ConfigError, match=r"several root links .*shelf. Exactly one is allowed; connect"):
        checked(file)
    circle = (
        '<link name="p"/><link name="q"/><joint name="pq" type="fixed">'
        '<parent link="p"/><child link="q"/></joint>'
        '<joint name="qp" type="fixed"><parent link="q"/><child link="p"/></joint></robot>'
    )
    file.write_text(ARM.replace("</robot>", circle))
    with pytest.raises(
        ConfigError, match=r"connect these links in a loop: p, q; .* remove the joint that closes"
    ):
        checked(file)


def made(folder: Path, text: str, **options: object) -> dict[str, dict[str, float]]:
    """The limits of the robot that is made."""
    (folder / "arm.urdf").write_text(text)
    NewRobot(folder / "arm.urdf", **options).write(folder / "made")  # type: ignore[arg-type]
    limits = yaml.safe_load((folder / "made" / "joint_limits.yaml").read_text())["joint_limits"]
    assert isinstance(limits, dict)
    return limits


def test_a_missing_end_of_a_range_is_0_and_a_continuous_joint_has_none(tmp_path: Path) -> None:
    text = ARM.replace('lower="-2.9" upper="2.9"', 'upper="0.123456789012"', 1)
    text = text.replace('lower="-2.9" upper="2.9"', 'lower="-0.123456789012"', 1)
    text = text.replace('name="a2" type="revolute"', 'name="a2" type="continuous"')
    limits = made(tmp_path, text)
    assert (limits["a0"]["min_position"], limits["a0"]["max_position"]) == (0.0, 0.123456789012)
    assert (limits["a1"]["min_position"], limits["a1"]["max_position"]) == (-0.123456789012, 0.0)
    assert limits["a2"]["max_position"] == pytest.approx(6.283185307179586)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('lower="-2.9" upper="2.9"', "", "joint 'a0' is revolute and has a range of 0.*--without a0"),
        ('lower="-2.9" upper="2.9"', 'lower="1" upper="1"', "make it continuous, or leave it out"),
        ('upper="2.9"', 'upper="1e4"', "'a0': max_position is 10000, .*less than 1000; .*--without a0"),
        ('velocity="1.5"', 'velocity="1e7"', "'a0': max_velocity is 1e.07, cobot supports less than 1000000"),
        ('effort="200"', 'effort="1e9"', "'a0': max_effort is 1e.09, cobot supports less than 1000000"),
    ],
)
def test_a_range_of_nothing_and_limits_beyond_cobots_are_rejected(
    tmp_path: Path, old: str, new: str, reason: str
) -> None:
    with pytest.raises(ConfigError, match=rf"arm\.urdf:\d+: .*{reason}"):
        made(tmp_path, ARM.replace(old, new, 1))
    assert [file.name for file in tmp_path.iterdir()] == ["arm.urdf"]


@pytest.mark.parametrize(("old", "new"), [('upper="2.9"', 'upper="1e4"'), ('lower="-2.9" upper="2.9"', "")])
def test_the_option_that_is_offered_for_bad_limits_works_when_it_is_typed(
    tmp_path: Path, old: str, new: str
) -> None:
    """It names all such joints, and those that are left out already."""
    text = ARM.replace(old, new, 2).replace('name="a1"', 'name="arm/joint 1"')
    with pytest.raises(ConfigError, match="leave all 2 such joints out with --without") as refused:
        made(tmp_path, text, without=["a5"])
    option, *names = shlex.split(str(refused.value).partition(" out with ")[2])
    assert (option, names) == ("--without", ["a5", "a0", "arm/joint 1"])
    assert list(made(tmp_path, text, without=names)) == ["a2", "a3", "a4"]


def test_leaving_out_every_joint_is_not_offered(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"correct it in the file$"):
        made(tmp_path, ARM.replace('upper="2.9"', 'upper="1e4"'))


def test_a_mimic_of_a_fixed_joint_means_nothing_and_its_name_can_be_typed(tmp_path: Path) -> None:
    tool = (
        '<link name="camera"/><joint name="mount" type="fixed"><parent link="link5"/><child link="camera"/>'
        '<mimic joint="ghost"/></joint></robot>'
    )
    limits = made(tmp_path, ARM.replace("</robot>", tool), without=["mount"])
    assert list(limits) == [f"a{index}" for index in range(6)]


def test_a_joint_in_a_transmission_is_none_of_the_arms(tmp_path: Path) -> None:
    text = ARM.replace("</robot>", '<transmission name="t"><joint name="a0"/></transmission></robot>')
    assert list(made(tmp_path, text)) == [f"a{index}" for index in range(6)]


@pytest.mark.parametrize(
    ("element", "reason"),
    [
        ('<replicate count="900000000"><geom size="1"/></replicate>', "<replicate> makes 9\\d+ elements"),
        (
            '<replicate count="400"><replicate count="400"><geom size="1"/></replicate></replicate>',
            "elements",
        ),
        ('<composite type="grid" count="3000 3000 1"/>', "<composite> makes 9\\d+ elements"),
        ('<replicate count="501"><body><joint/></body></replicate>', "<joint> makes 501 joints in the file"),
        (
            '<flexcomp name="f" count="2 2 2"/>',
            "<flexcomp> makes a soft body; cobot checks collisions of rigid bodies only: remove it",
        ),
        ('<deformable><flex name="f"/></deformable>', "<flex> makes a soft body"),
        ('<body pos="0 0 nan"/>', "pos of <body> contains 'nan'; it must be a finite number"),
        ('<body name="inf"><joint range="-INF 1"/></body>', "range of <joint> contains '-INF'"),
        (
            f'<body name="{"n" * 100_000}"/>',
            "<body> has the name 'n{10,60}'\\.\\.\\.; give it a printable name",
        ),
        ('<replicate prefix="a&#10;"/>', r"<replicate> has the name 'a\\n'; give it a printable name"),
        ('<replicate count="0x10"/>', "count of <replicate> is '0x10'; it must be a whole number"),
        ('<include file="arm.xml"/>', "included files; at most 100"),
        (f'<replicate count="{" " * 300}900000000"><geom/></replicate>', "<replicate> makes 9\\d+ elements"),
        (
            f'<composite count="{"1e300 " * 33}"/>',
            "<composite> makes more than 1000000000000 elements in the file; at most 5000",
        ),
        ('<size nkey="900000000"/>', "<size> makes 900000000 entries by nkey; at most 5000"),
        ('<size nuser_geom="900000000"/>', "<size> makes 900000000 entries by nuser_geom"),
    ],
)
def test_monstrous_mjcf_is_counted_before_it_is_made(tmp_path: Path, element: str, reason: str) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(f"<mujoco><worldbody>\n{element}</worldbody></mujoco>")
    with pytest.raises(ConfigError, match=rf"arm\.xml:\d: .*{reason}"):
        check_mjcf(file, parse(file)[0])


def test_what_an_attached_model_makes_is_counted_each_time(tmp_path: Path) -> None:
    """Oracle for the number of elements that are allowed: MuJoCo, which makes them."""
    attached = '<attach model="part" body="b" prefix="{}"/>'
    part = '<mujoco><worldbody><body name="b"><replicate count="{}"><geom size="1"/></replicate></body>'
    file = tmp_path / "arm.xml"

    def write(count: int, times: int) -> None:
        (tmp_path / "part.xml").write_text(part.format(count) + "</worldbody></mujoco>")
        bodies = "".join(attached.format(index) for index in range(times))
        file.write_text(
            f'<mujoco><worldbody>{bodies}</worldbody>\n<asset><model name="part" file="part.xml"/></asset>'
            "</mujoco>"
        )

    write(900_000_000, 1)
    with pytest.raises(ConfigError, match=r"part\.xml:1: <replicate> makes 9\d+ elements .*at most 5000"):
        check_mjcf(file, parse(file)[0])
    write(1300, 4)
    with pytest.raises(ConfigError, match=r"part\.xml:1: .* elements in the file; at most 5000"):
        check_mjcf(file, parse(file)[0])
    write(300, 4)
    check_mjcf(file, parse(file)[0])
    assert mujoco.MjModel.from_xml_path(str(file)).ngeom == 1200


def test_a_monstrous_height_field_is_rejected(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(
        '<mujoco><asset><hfield name="h" nrow="99999" ncol="99999" size="1 1 1 1"/></asset></mujoco>'
    )
    with pytest.raises(ConfigError, match=r"arm\.xml:1: <hfield> makes 9999800001 cells; at most 4000000"):
        check_mjcf(file, parse(file)[0])


@pytest.mark.parametrize(
    ("element", "reason"),
    [
        ('<size memory="900G"/>', "needs more than 4 GB of memory; simplify it"),
        ('<size memory="6G"/>', "needs more than 4 GB of memory; simplify it"),
        (
            '<asset><mesh name="m" builtin="supersphere" params="100000 1 1"/></asset>',
            "MuJoCo fails to load it without a clear reason: .*a size in the file is far too large",
        ),
    ],
)
def test_memory_that_nothing_announces_is_bounded(tmp_path: Path, element: str, reason: str) -> None:
    """MuJoCo would allocate it: the worker may not."""
    file = tmp_path / "arm.xml"
    file.write_text(f'<mujoco>{element}<worldbody><body name="b"><joint name="j"/><geom size="1"/></body>'
                    "</worldbody></mujoco>")  # fmt: skip
    with pytest.raises(ConfigError, match=rf"arm\.xml: {reason}"):
        NewRobot(file).write(tmp_path / "made")
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("seed", few(range(6), 2))
def test_whatever_is_in_a_file_it_is_made_or_rejected_in_words(
    tmp_path: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command itself, so that any other exception is one here. `python -m benchmarks corpus --fuzz 500`
    breaks more of them.
    """
    whole = tmp_path / "arm.urdf"
    whole.write_text(ARM)
    files = [whole, *sources(tmp_path / "whole")]
    for file in broken_files(files, tmp_path, 6, seed):
        code = main(["new-robot", str(file), "--output", str(tmp_path / file.stem)])
        said = capsys.readouterr().err
        assert judge(code, said, file, tmp_path / file.stem) == "", said
