"""Fingers that turn become a gripper. Oracles: trigonometry, and the distances and contacts of MuJoCo."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from physical_cell import CellArm, write_cell
from scipy.spatial.transform import Rotation
from urdf_arms import ARMS, urdf

from cobot.cell import TurningHand, cell_of, hand_of
from cobot.cell.plant_hands import FOLLOWER
from cobot.config import Settings, load_settings
from cobot.contract_checks import CheckVerdict
from cobot.errors import ConfigError
from cobot.grippers.contract.suite import CHECKS, examine, subject_for
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.robot.description import load_robot
from cobot.types import Array, Pose
from rtloop.backends import Impedance

KNUCKLE_M, TIP_M, HALF_M = 0.06, 0.04, 0.005
END_M = 0.02
KNUCKLE, TIP = "0.01 0.02 0.06", "0.01 0.02 0.04"


def part(name: str, parent: str, joint: str, box: str, middle: str) -> str:
    """A link with a box."""
    return (
        f'<link name="{name}"><inertial><origin xyz="{middle}"/><mass value="0.05"/><inertia ixx="2e-5" '
        f'iyy="2e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="{middle}"/>'
        f'<geometry><box size="{box}"/></geometry></collision></link><joint name="{name}_joint" {joint}'
        f'<parent link="{parent}"/><child link="{name}"/></joint>'
    )


def turns(place: str, low: float, high: float, mimic: str = "") -> str:
    return (
        f'type="revolute"><origin xyz="{place}"/><axis xyz="0 1 0"/><limit lower="{low}" upper="{high}" '
        f'velocity="1" effort="5"/>{mimic}'
    )


def follows(ratio: int) -> str:
    return f'<mimic joint="left_knuckle_joint" multiplier="{ratio}"/>'


PALM = part("palm", "tool0", 'type="fixed"><origin xyz="0 0 0"/>', "0.1 0.04 0.02", "0 0 0.01")
LINKAGE = PALM + "".join(
    part(f"{side}_knuckle", "palm", turns(f"{sign * 0.01} 0 0.02", *range_, mimic), KNUCKLE, "0 0 0.03")
    + part(f"{side}_tip", f"{side}_knuckle", turns("0 0 0.06", -1, 1, follows(-sign)), TIP, "0 0 0.02")
    for side, sign, range_, mimic in (
        ("left", 1, (-0.3, 0.7), ""),
        ("right", -1, (-0.7, 0.3), follows(-1)),
    )
)
"""Two fingers whose tips stay parallel."""
LENGTH_M = 0.1
JAW = (
    PALM
    + part("fixed_finger", "palm", 'type="fixed"><origin xyz="0 0 0.02"/>', "0.01 0.02 0.1", "-0.005 0 0.05")
    + part("jaw", "palm", turns("0 0 0.02", -0.2, 1.2), "0.01 0.02 0.1", "0.005 0 0.05")
)


def made(folder: Path, extra: str) -> tuple[Settings, str]:
    """The settings of a robot, and what was reported about it."""
    file = folder / "arm.urdf"
    file.write_text(urdf(ARMS["ur"], extra).replace("tool0", "plate"), encoding="utf-8")
    new = NewRobot(file)
    new.write(folder / "arm")
    return load_settings(folder / "arm" / "cobot-setting.yaml"), "\n".join(new.guessed)


@pytest.fixture(scope="module")
def linkage(tmp_path_factory: pytest.TempPathFactory) -> tuple[Settings, str]:
    return made(tmp_path_factory.mktemp("linkage"), LINKAGE)


@pytest.fixture(scope="module")
def jaw(tmp_path_factory: pytest.TempPathFactory) -> tuple[Settings, str]:
    return made(tmp_path_factory.mktemp("jaw"), JAW)


def hand(settings: Settings) -> TurningHand:
    found = hand_of(settings)
    assert isinstance(found, TurningHand)
    return found


def test_the_width_of_a_linkage_is_that_between_its_tips(linkage: tuple[Settings, str]) -> None:
    """The knuckles stand upright at 0, where the tips are 2 HALF_M apart."""
    found, said = hand(linkage[0]), linkage[1]
    closed = -np.arcsin(HALF_M / KNUCKLE_M)
    angles = np.linspace(closed, 0.7, len(found.widths_m))
    np.testing.assert_allclose(found.widths_m, 2 * (HALF_M + KNUCKLE_M * np.sin(angles)), atol=2e-5)
    assert found.travel_rad == pytest.approx(0.7 - closed, abs=5e-4)
    assert found.max_force_n == pytest.approx(5.0 / (2 * KNUCKLE_M), rel=2e-2)
    further_m = KNUCKLE_M * (np.cos(closed) - np.cos(0.7))
    assert f"0 to {1e3 * found.stroke_m:.3g} mm wide between the ends" in said
    assert f"and at {closed:.4g} rad when closed and they reach {1e3 * further_m:.0f} mm further out" in said


def test_the_width_of_a_jaw_is_that_between_its_end_and_the_fixed_finger(jaw: tuple[Settings, str]) -> None:
    """The corner where the end of the jaw begins is on a circle around the axis: the width is a chord.

    The end is cut off at right angles to the line from the axis to the tip.
    """
    found = hand(jaw[0])
    angles = np.linspace(0.0, 1.2, len(found.widths_m))
    tip_m = np.hypot(LENGTH_M, 2 * HALF_M)
    chords_m = 2 * (tip_m - END_M) * tip_m / LENGTH_M * np.sin(0.5 * angles)
    np.testing.assert_allclose(found.widths_m, chords_m, atol=1e-4)
    assert "further out" not in jaw[1], "the fixed finger reaches as far"


def test_the_tcp_is_where_the_tips_meet(linkage: tuple[Settings, str]) -> None:
    settings, said = linkage
    robot = load_robot(settings).model.mj
    data = mujoco.MjData(robot)
    mujoco.mj_kinematics(robot, data)
    site, palm = data.site("between_fingers"), data.body("palm")
    frame = palm.xmat.reshape(3, 3)
    upright = 0.02 + KNUCKLE_M * np.sqrt(1.0 - (HALF_M / KNUCKLE_M) ** 2) + TIP_M
    np.testing.assert_allclose(frame.T @ (site.xpos - palm.xpos), [0.0, 0.0, upright - 0.01], atol=1e-3)
    np.testing.assert_allclose(frame.T @ site.xmat.reshape(3, 3), np.eye(3), atol=1e-6)
    assert "tcp between_fingers" in said


def distance(arm: CellArm, first: str, second: str) -> float:
    """MuJoCo's, between two links of the plant."""
    mj, data = arm.backend.plant.mj, arm.backend._plant_data
    shapes = [np.flatnonzero(mj.geom_bodyid == mj.body(name).id) for name in (first, second)]
    return min(
        mujoco.mj_geomDistance(mj, data, int(one), int(other), 1.0, None)
        for one in shapes[0]
        for other in shapes[1]
    )


def test_the_simulation_moves_the_tips_to_each_width(linkage: tuple[Settings, str], tmp_path: Path) -> None:
    settings, _ = linkage
    arm = CellArm(settings, load_robot(settings), write_cell(tmp_path, {"floor_m": None}))
    assert arm.read("hand.measured_width") == pytest.approx(hand(settings).stroke_m, abs=1e-4)
    for width in (0.05, 0.02, 0.0, 0.035, hand(settings).stroke_m):
        arm.move_hand(width, speed=0.05)
        assert arm.read("hand.measured_width") == pytest.approx(width, abs=3e-4)
        assert distance(arm, "left_tip", "right_tip") == pytest.approx(width, abs=6e-4)


def test_a_pull_at_a_finger_leaves_no_effort_in_the_hand(
    linkage: tuple[Settings, str], tmp_path: Path
) -> None:
    """Oracle: MuJoCo's qfrc_applied of the joints that follow, which no drive writes."""
    settings, _ = linkage
    arm = CellArm(settings, load_robot(settings), write_cell(tmp_path, {"floor_m": None}))
    stiffness = arm.backend.nominal_stiffness
    arm.backend.set_impedance(Impedance(False, stiffness, np.full(len(stiffness), 0.7)))
    arm.backend.pull("left_tip", np.zeros(3), np.array([0.0, 2.0, 0.5]))
    arm.hold(100)
    mj, applied = arm.backend.plant.mj, arm.backend._plant_data.qfrc_applied
    dof = len(arm.joints)
    followers = [
        int(mj.jnt_dofadr[each]) for each in range(dof, mj.njnt) if mj.joint(each).name.startswith(FOLLOWER)
    ]
    assert np.abs(applied[:dof]).max() > 0.1
    assert len(followers) == 3
    np.testing.assert_array_equal(applied[followers], 0.0)
    arm.hold(200)
    np.testing.assert_array_equal(applied[:dof], 0.0)


@pytest.mark.parametrize("kind", ["linkage", "jaw"])
def test_it_holds_a_part_with_the_force_of_the_command(
    kind: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """Oracle: MuJoCo's contact forces. The part floats between the fingers until they hold it."""
    settings, _ = request.getfixturevalue(kind)
    robot = load_robot(settings)
    home = np.array(robot.positions[settings.robot.start_position].joints)
    tcp = robot.model.forward(home)
    place = tcp if kind == "linkage" else tcp @ Pose(np.array([0.015, 0.0, 0.0]), np.array([1.0, 0, 0, 0]))
    edge_m, force_n = 0.03, 15.0
    size = [edge_m, 0.02, 0.01] if kind == "linkage" else [0.015]
    angles = np.degrees(_fixed_angles(place))
    part = {
        "shape": "box" if kind == "linkage" else "sphere",
        "size_m": size,
        "mass_kg": 0.02,
        "position_m": place.position.tolist(),
        "rotation_deg": angles.tolist(),
    }
    cell = write_cell(tmp_path, {"floor_m": None, "parts": {"part": part}})
    arm = CellArm(settings, robot, cell)
    mj, data = arm.backend.plant.mj, arm.backend._plant_data
    data.xfrc_applied[mj.body("part").id, 2] = 9.81 * 0.02
    arm.move_hand(0.0, force_n, 0.05)
    arm.hold(300)
    assert arm.read("hand.measured_force") == pytest.approx(force_n, rel=0.01)
    forces: dict[str, float] = {}
    for index, contact in enumerate(data.contact):
        names = {mj.body(mj.geom_bodyid[geom]).name for geom in (contact.geom1, contact.geom2)}
        if "part" in names:
            force = np.zeros(6)
            mujoco.mj_contactForce(mj, data, index, force)
            (other,) = names - {"part"}
            forces[other] = forces.get(other, 0.0) + float(force[0])
    assert len(forces) == 2, forces
    for pressed in forces.values():
        # A jaw presses where the part is, which is 10 mm further from its axis than the width is measured.
        assert pressed == pytest.approx(force_n if kind == "linkage" else force_n * 0.08 / 0.09, rel=0.05)


def _fixed_angles(pose: Pose) -> Array:
    """About the fixed x, y and z axes, rad."""
    w, x, y, z = pose.quaternion
    return np.array(Rotation.from_quat([x, y, z, w]).as_euler("xyz"))


@pytest.mark.parametrize("check", CHECKS)
def test_the_contract_of_grippers_holds(check: str, linkage: tuple[Settings, str]) -> None:
    options = hand(linkage[0]).model_dump(mode="json") | {"widths_m": [0.004, 0.02, 0.06]}
    result = examine(subject_for(load_settings(), "simulated", {"hand": options}), check)
    assert result.verdict is not CheckVerdict.FAILED, result.text


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"widths": []}, r"robot\.gripper\.hand: unknown key 'widths' \(did you mean 'widths_m'\?\)"),
        ({"widths_m": [0.0, 0.02, 0.01]}, r"widths_m: \[2\] is 0\.01 after 0\.02; each must be"),
        ({"widths_m": [0.0]}, r"widths_m"),
        ({"travel_rad": 0.0}, r"travel_rad: must be greater than or equal to 0\.02"),
        ({"joints": []}, r"joints"),
    ],
)
def test_a_wrong_description_names_what_is_wrong(
    linkage: tuple[Settings, str], change: dict[str, object], words: str
) -> None:
    settings, _ = linkage
    gripper = settings.robot.gripper
    assert gripper is not None
    options = gripper.options | {"hand": {**gripper.options["hand"], **change}}
    robot = settings.robot.model_copy(update={"gripper": gripper.model_copy(update={"options": options})})
    with pytest.raises(ConfigError, match=words):
        cell_of(settings.model_copy(update={"robot": robot}))


SECOND = part("thumb", "palm", turns("0 0.03 0.02", -0.2, 1.2), "0.01 0.02 0.1", "0.005 0 0.05")


@pytest.mark.parametrize(
    ("fingers", "why"),
    [
        (
            JAW + SECOND,
            (
                "cobot simulates fingers that one joint moves, but these have 2 such joints: jaw_joint, "
                "thumb_joint"
            ),
        ),
        (JAW.replace('lower="-0.2" upper="1.2"', 'lower="0" upper="0.01"'), "jaw_joint turns by 0.01 rad"),
        (PALM + JAW[JAW.index('<link name="jaw"') :], "it has no second finger where the first one ends"),
        (LINKAGE.replace('lower="-0.3"', 'lower="0.3"'), "the ends of its fingers are 45.5 to 87.3 mm apart"),
    ],
)
def test_fingers_without_a_width_stay_where_they_are(fingers: str, why: str, tmp_path: Path) -> None:
    settings, said = made(tmp_path, fingers)
    assert f"gripper found; its joints stay where they are, with mass and shapes ({why}" in said
    assert settings.robot.gripper is None
