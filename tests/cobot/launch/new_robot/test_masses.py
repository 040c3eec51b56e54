"""Masses and inertias that `cobot new-robot` assumes or repairs. Oracles: the volumes of spheres and
cylinders, pinocchio's masses and inertias of the same file, and the triangle inequality.
"""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from urdf_arms import ARMS, urdf

from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.launch.cli import main
from cobot.launch.new_robot import volumes
from cobot.launch.new_robot.masses import DENSITY_KG_M3, Wishes
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.robot.description import load_robot
from cobot.robot.model import RobotModel

BALL = 4.0 / 3.0 * math.pi * 0.03**3
INERTIAL = (
    '<inertial><origin xyz="0 0 0.05"/><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" '
    'ixz="0" iyz="0"/></inertial>'
)


def with_link(link: str, text: str, shape: str | None = None) -> str:
    """The arm with another inertial in one of its links, and perhaps another shape."""
    before, name, rest = urdf(ARMS["ur"]).partition(f'<link name="{link}">')
    body, end, after = rest.partition("</link>")
    body = body.replace(INERTIAL, text)
    if shape is not None:
        body = body[: body.index("<collision>")] + shape
    return before + name + body + end + after


def made(tmp_path: Path, text: str, **options: object) -> tuple[RobotModel, list[str]]:
    file = tmp_path / ("arm.xml" if text.startswith("<mujoco") else "arm.urdf")
    file.write_text(text)
    new = NewRobot(file, **options)  # type: ignore[arg-type]
    new.write(tmp_path / "made")
    return load_robot(load_settings(tmp_path / "made" / "cobot-setting.yaml")).model, new.guessed


def mass_of(robot: RobotModel, link: str) -> float:
    return float(robot.mj.body(link).mass[0])


@pytest.mark.parametrize(("offset", "balls"), [(0.0, 1), (1.0, 500)])
def test_each_of_many_shapes_is_looked_at_once(
    offset: float, balls: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A look for each pair would take minutes. Balls at one place have the volume of one of them."""
    looks: list[int] = []
    holds = volumes._Shape.holds
    monkeypatch.setattr(
        volumes._Shape, "holds", lambda shape, points: looks.append(len(points)) or holds(shape, points)
    )
    mj = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body><joint/><replicate count="500" offset="{offset} 0 0"><geom size=".1"/>'
        "</replicate></body></worldbody></mujoco>"
    )
    solid = volumes.solid(mj, 1, np.ones(mj.ngeom, dtype=bool))
    assert solid is not None
    assert solid.volume == pytest.approx(balls * BALL * (0.1 / 0.03) ** 3)
    assert len(looks) == 500
    assert max(looks) <= volumes.MAX_POINTS


@pytest.mark.parametrize(
    "missing",
    [
        "",
        '<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>',
        '<inertial><mass value="-1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>',
        '<inertial><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>',
    ],
)
def test_a_link_without_a_mass_gets_that_of_its_shape_and_is_listed(tmp_path: Path, missing: str) -> None:
    robot, said = made(tmp_path, with_link("link2", missing))
    mass = DENSITY_KG_M3 * BALL
    assert mass_of(robot, "link2") == pytest.approx(mass)
    np.testing.assert_allclose(robot.mj.body("link2").inertia, 0.4 * mass * 0.03**2, rtol=1e-6)
    listed = [sentence for sentence in said if sentence.startswith("link")]
    assert len(listed) == 1
    assert listed[0].startswith(f"link2: mass {mass:.4g} kg assumed, 1100 kg/m³ times its shapes (0.113 L): ")
    assert any(sentence.startswith(f"total mass {12 + mass:.4g} kg") for sentence in said)


def test_an_arm_with_all_inertials_has_pinocchios_masses_and_no_link_is_listed(tmp_path: Path) -> None:
    robot, said = made(tmp_path, urdf(ARMS["ur"]))
    model = pinocchio.buildModelFromXML(urdf(ARMS["ur"]))
    assert robot.mj.body_mass.sum() == pytest.approx(pinocchio.computeTotalMass(model))
    assert not [sentence for sentence in said if sentence.startswith(("link", "tool0"))]


def test_a_mass_without_an_inertia_keeps_the_mass_and_takes_the_shape(tmp_path: Path) -> None:
    robot, said = made(tmp_path, with_link("link2", '<inertial><mass value="3"/></inertial>'))
    assert mass_of(robot, "link2") == 3.0
    np.testing.assert_allclose(robot.mj.body("link2").inertia, 0.4 * 3.0 * 0.03**2, rtol=1e-6)
    assert (
        "link2: 3 kg as in the file, with the inertia of its shapes: its inertia in the file is missing"
        in said
    )


def test_shapes_that_overlap_count_once(tmp_path: Path) -> None:
    """A capsule as files have it: a cylinder and a ball at each end."""
    ball = '<collision><origin xyz="0 0 {}"/><geometry><sphere radius="0.05"/></geometry></collision>'
    rod = '<collision><geometry><cylinder radius="0.05" length="0.2"/></geometry></collision>'
    robot, _ = made(tmp_path, with_link("link2", "", rod + ball.format(0.1) + ball.format(-0.1)))
    volume = math.pi * 0.05**2 * 0.2 + 4.0 / 3.0 * math.pi * 0.05**3
    assert mass_of(robot, "link2") == pytest.approx(DENSITY_KG_M3 * volume, rel=0.03)


def test_density_and_masses_are_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(with_link("link2", ""))
    options = ["--density", "2000", "--mass", "link3=5", "link4=0.5", "--output", str(tmp_path / "made")]
    assert main(["new-robot", str(file), *options]) == 0
    robot = load_robot(load_settings(tmp_path / "made" / "cobot-setting.yaml")).model
    assert [mass_of(robot, link) for link in ("link2", "link3", "link4")] == pytest.approx(
        [2000.0 * BALL, 5.0, 0.5]
    )
    np.testing.assert_allclose(robot.mj.body("link3").inertia, 0.02 * 2.5)
    assert "link3: mass 5 kg by --mass, and its inertia of the file in proportion" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("wishes", "reason"),
    [
        (Wishes(density=0.0), "--density is 0 kg/m³, allowed: 1 to 30000 kg/m³"),
        (Wishes(density=math.nan), "--density is nan"),
        (
            Wishes(masses={"hand": 1.0}),
            "--mass: the robot has no link 'hand'; valid names: .*base_link, link0",
        ),
        (Wishes(masses={"link1": -1.0}), "--mass of link1 is -1 kg, allowed: above 0"),
        (Wishes(masses={"link1": math.inf}), "--mass of link1 is inf kg"),
    ],
)
def test_a_density_or_mass_that_cannot_be_is_rejected(tmp_path: Path, wishes: Wishes, reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        made(tmp_path, urdf(ARMS["ur"]), wishes=wishes)


def test_a_mass_that_is_no_number_names_the_form(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["new-robot", "arm.urdf", "--mass", "link1"])
    assert "'link1' is not LINK=KG" in capsys.readouterr().err


def test_a_moving_link_without_shape_and_mass_becomes_a_small_ball_and_is_listed(tmp_path: Path) -> None:
    robot, said = made(tmp_path, with_link("link4", "", ""))
    mass = mass_of(robot, "link4")
    assert 0.0 < mass < 0.5
    assert [
        sentence for sentence in said if sentence.startswith(f"link4: mass {mass:.3g} kg assumed, a ball")
    ]


def test_a_frame_without_mass_stays_without(tmp_path: Path) -> None:
    text = urdf(ARMS["ur"]).replace(f'<link name="tool0">{INERTIAL}', '<link name="tool0">')
    robot, said = made(tmp_path, text)
    assert mass_of(robot, "tool0") == 0.0
    assert "mass 0 kg, without shape and fixed to a link that has mass: tool0" in said


@pytest.mark.parametrize(
    ("moments", "reason"),
    [
        ((0.01, 0.01, 0.05), "inertia repaired: no body has the principal moments 0.01, 0.01, 0.05 kg·m²"),
        ((-0.01, 0.02, 0.02), "inertia repaired"),
        ((5e4, 5e4, 5e4), "inertia replaced: 2 kg with a radius of gyration of 194 m do not fit shapes"),
        ((1e-9, 1e-9, 1e-9), "inertia replaced"),
    ],
)
def test_an_inertia_that_no_body_can_have_is_repaired_and_listed(
    tmp_path: Path, moments: tuple[float, float, float], reason: str
) -> None:
    xx, yy, zz = moments
    inertial = (
        f'<inertial><mass value="2"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial>"
    )
    shape = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    robot, said = made(tmp_path, with_link("link2", inertial, shape))
    assert [sentence for sentence in said if sentence.startswith(f"link2: {reason}")]
    least, middle, greatest = np.sort(robot.mj.body("link2").inertia)
    assert least > 0.0
    assert greatest <= least + middle + 1e-12


def test_a_turned_inertia_that_bodies_can_have_is_left_as_it_is(tmp_path: Path) -> None:
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    tensor = turn @ np.diag([0.01, 0.015, 0.02]) @ turn.T
    values = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), tensor[np.triu_indices(3)].tolist(), strict=True)
    text = "".join(f' {name}="{value!r}"' for name, value in values)
    robot, said = made(
        tmp_path, with_link("link2", f'<inertial><mass value="2"/><inertia{text}/></inertial>')
    )
    np.testing.assert_allclose(np.sort(robot.mj.body("link2").inertia), [0.01, 0.015, 0.02], rtol=1e-9)
    assert not [sentence for sentence in said if sentence.startswith("link2")]


THIN = INERTIAL.replace('izz="0.02"', 'izz="0.05"')
SMALL = DENSITY_KG_M3 * BALL


@pytest.mark.parametrize(
    ("option", "sentence", "mass", "moment"),
    [
        ('boundmass="3"', "masses are raised to at least 3 kg, as the file asks", 3.0, 0.03),
        ('boundinertia="0.5"', "moments of inertia are raised to at least 0.5 kg·m², as the file", 2.0, 0.5),
        ('balanceinertia="true"', "link2: inertia balanced, as balanceinertia in the file asks", 2.0, 0.03),
        ('settotalmass="28"', "all masses scaled from 14 kg to 28 kg in total, as settotal", 4.0, 0.06),
        (
            'inertiafromgeom="true"',
            f"link2: mass {SMALL:.4g} kg assumed, 1100 kg/m³ times its shapes (0.113 L): inertiafromgeom in",
            SMALL,
            0.4 * SMALL * 0.03**2,
        ),
    ],
)
def test_options_of_the_compiler_count_and_are_reported(
    tmp_path: Path, option: str, sentence: str, mass: float, moment: float
) -> None:
    """The moments 0.02, 0.02 and 0.05 balanced are 0.03 each, as MuJoCo documents it."""
    text = with_link("link2", THIN if "balance" in option else INERTIAL.replace("0.02", "0.03"))
    robot, said = made(tmp_path, text.replace("</robot>", f"<mujoco><compiler {option}/></mujoco></robot>"))
    assert mass_of(robot, "link2") == pytest.approx(mass)
    np.testing.assert_allclose(robot.mj.body("link2").inertia, moment, rtol=1e-6)
    assert [each for each in said if each.startswith(sentence)], said


@pytest.mark.parametrize("strippath", ["true", "false"])
def test_meshdir_and_strippath_of_the_compiler_find_the_meshes(tmp_path: Path, strippath: str) -> None:
    """A tetrahedron with legs of 0.1 m has a sixth of a litre."""
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], dtype="<f4")
    faces = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    triangles = b"".join(bytes(12) + corners[list(face)].tobytes() + bytes(2) for face in faces)
    folder = tmp_path / "shapes" / ("" if strippath == "true" else "parts")
    folder.mkdir(parents=True)
    (folder / "a.stl").write_bytes(bytes(80) + (4).to_bytes(4, "little") + triangles)
    name = "package://somewhere/else/a.stl" if strippath == "true" else "parts/a.stl"
    shape = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
    option = f'<mujoco><compiler meshdir="shapes" strippath="{strippath}"/></mujoco></robot>'
    robot, _ = made(tmp_path, with_link("link2", "", shape).replace("</robot>", option))
    assert mass_of(robot, "link2") == pytest.approx(DENSITY_KG_M3 * 0.1**3 / 6.0, rel=1e-5)


def test_mjcf_keeps_the_densities_of_its_file_and_lists_the_masses(tmp_path: Path) -> None:
    text = (
        '<mujoco><worldbody><body name="one" pos="0 0 .2"><joint name="j" range="-90 90"/>'
        '<geom size=".03" pos=".1 0 0" density="500"/></body></worldbody></mujoco>'
    )
    robot, said = made(tmp_path, text)
    assert mass_of(robot, "one") == pytest.approx(500.0 * BALL)
    assert [
        each for each in said if each.startswith("one: mass 0.05655 kg of its shapes (0.113 L) at the dens")
    ]


def test_nothing_but_made_up_masses_is_rejected_with_the_way_out(tmp_path: Path) -> None:
    text = urdf(ARMS["ur"], inertial=False)
    ball = '<collision><geometry><sphere radius="0.03"/></geometry></collision>'
    with pytest.raises(ConfigError, match=r"no link that moves has .* or give masses: --mass link0=KG"):
        made(tmp_path, text.replace(ball, ""))


def test_a_mass_that_is_not_finite_names_the_line_and_the_link(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"arm\.urdf:1: link 'link2': value of <mass> is 'nan'; it must be a decimal number"
    ):
        made(tmp_path, with_link("link2", INERTIAL.replace('mass value="2"', 'mass value="nan"')))
