"""A cell as planners see it: fixtures and held parts become objects of the scene, and the hand becomes a
tool.
"""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.cell.cell import CUP, HAND, Belt, Cell, CellPart, CellSolid, Cup, Hand, load_cell
from cobot.cell.own_hand import AnyHand, cell_of, hand_of
from cobot.config import Settings
from cobot.robot.scene import SceneFile, SceneObject
from cobot.robot.tool import BARE, Tool, ToolFile
from cobot.types import Numbers7, Pose

CLEAR_M, MIN_EDGE_M = 0.025, 0.002
"""Distance before the TCP at which the fingers end for the planners, and smallest length of a shape that
the planners see, m. The distance exists because streams keep 20 mm away from everything, but the TCP must
reach parts on a table.
"""
LIP_M = 0.004
"""Height of the lip of a cup, m. The lip has no mass."""
FINGER_SHARE = 0.1
"""Share of the hand's mass in each finger."""


def scene_file(settings: Settings) -> SceneFile:
    """The file with the robot's scene. The fixtures of the robot's cell are added to it.

    Raises:
        ConfigError: the cell file is invalid.
    """
    cell = settings.robot.cell
    return SceneFile(settings.scene_file, {} if cell is None else fixtures_in_scene(load_cell(cell)))


def tool_file(settings: Settings) -> ToolFile:
    """The file with the robot's tool. Until a tool is set, the tool is the hand or the cup of the robot's
    cell.

    Raises:
        ConfigError: the cell file is invalid.
    """
    return ToolFile(settings.tool_file, first_tool(hand_of(settings), cell_of(settings)))


def first_tool(hand: AnyHand | None, cell: Cell | None) -> Tool:
    """The hand or the cup of the cell file as a tool. BARE if the cell file contains neither, or if the arm's
    model contains the hand.
    """
    if cell is not None and cell.cup is not None:
        return cup_as_tool(cell.cup)
    return hand_as_tool(hand) if isinstance(hand, Hand) else BARE


def part_in_scene(part: CellPart, pose: Numbers7) -> SceneObject:
    """A part as an object of the scene. `pose` is its pose in the base frame."""
    return _in_scene(part, pose, part.mass_kg)


def fixtures_in_scene(cell: Cell) -> dict[str, SceneObject]:
    """The fixtures and belts as objects of the scene."""
    return {name: _in_scene(solid, pose_of(solid).numbers) for name, solid in cell.solids()}


def _in_scene(solid: CellSolid | Belt, pose: Numbers7, mass_kg: float = 0.0) -> SceneObject:
    if isinstance(solid, Belt):
        return SceneObject(shape="box", size=tuple(solid.size_m), pose=pose)
    if solid.shape != "mesh":
        return SceneObject(shape=solid.shape, size=tuple(solid.size_m), pose=pose, mass=mass_kg)
    return SceneObject(
        shape="mesh",
        size=solid.mesh.size,
        pose=pose,
        mass=mass_kg,
        boxes=solid.mesh.boxes,
        hulls=solid.mesh.hulls,
        tolerance=solid.tolerance_m if solid.mesh.boxes else 0.0,
    )


def hand_as_tool(hand: Hand) -> Tool:
    """The first tool of the robot, with mass, TCP and shapes. The robot carries it while its hand is empty.

    The fingers are open, and end `CLEAR_M` before the TCP.
    """
    palm, fingers = (1.0 - 2.0 * FINGER_SHARE) * hand.mass_kg, 2.0 * FINGER_SHARE * hand.mass_kg
    height, beside = hand.palm_m[2], 0.5 * (hand.stroke_m + hand.finger_m[0])
    length = hand.finger_m[2] - hand.tcp_from_tip_m - CLEAR_M
    centre = (palm * 0.5 * height + fingers * (height + 0.5 * hand.finger_m[2])) / hand.mass_kg
    return Tool(
        version=1,
        name=HAND,
        mass=hand.mass_kg,
        centre=(0.0, 0.0, centre),
        tcp=(0.0, 0.0, hand.tcp_m, 1.0, 0.0, 0.0, 0.0),
        shapes={
            HAND: _box(hand.palm_m, 0.0, 0.5 * height),
            **{
                f"{HAND}.finger{number}": _box(
                    (*hand.finger_m[:2], length), side * beside, height + 0.5 * length
                )
                for number, side in ((1, 1.0), (2, -1.0))
                if length > MIN_EDGE_M
            },
        },
    )


def cup_as_tool(cup: Cup) -> Tool:
    """The first tool of a robot whose cell contains a suction cup, with mass, TCP and shape. The shape ends
    `CLEAR_M` before the TCP.
    """
    length = cup.length_m - CLEAR_M
    pose = (0.0, 0.0, 0.5 * length, 1.0, 0.0, 0.0, 0.0)
    shape = SceneObject(shape="cylinder", size=(cup.radius_m, length), pose=pose)
    return Tool(
        version=1,
        name=CUP,
        mass=cup.mass_kg,
        centre=(0.0, 0.0, 0.5 * (cup.length_m - LIP_M)),
        tcp=(0.0, 0.0, cup.length_m, 1.0, 0.0, 0.0, 0.0),
        shapes={CUP: shape} if length > MIN_EDGE_M else {},
    )


def _box(edges: tuple[float, float, float], x: float, z: float) -> SceneObject:
    return SceneObject(shape="box", size=edges, pose=(x, 0.0, z, 1.0, 0.0, 0.0, 0.0))


def pose_of(solid: CellSolid | Belt) -> Pose:
    """The pose of a solid in the base frame."""
    quaternion = np.zeros(4)
    mujoco.mju_euler2Quat(quaternion, np.radians(solid.rotation_deg), "XYZ")
    return Pose(np.array(solid.position_m), quaternion)
