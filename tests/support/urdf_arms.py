"""Small URDF arms: no sizes of a real one, every kind of structure."""

from __future__ import annotations

Joint = tuple[str, tuple[float, float, float], tuple[float, float, float]]
R = 2.9
SPACED = (0.0, 0.0, 0.25)
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
ARMS: dict[str, list[Joint]] = {
    "srs": [("r", axis, place) for axis, place in zip(
        (Z, Y, Z, Y, Z, Y, Z), (SPACED, SPACED, SPACED, SPACED, SPACED, SPACED, SPACED), strict=True)],
    "ur": [("r", Z, SPACED), ("r", Y, (0, 0.1, 0.1)), ("r", Y, (0, 0, 0.4)), ("r", Y, (0, 0, 0.4)),
           ("r", Z, (0, 0.15, 0)), ("r", Y, (0, 0, 0.15))],
    "spherical": [("r", Z, SPACED), ("r", Y, (0.2, 0, 0.2)), ("r", Y, (0, 0, 0.5)), ("r", Z, (0, 0, 0.3)),
                  ("r", Y, (0, 0, 0.2)), ("r", Z, (0, 0, 0.2))],
    "gantry": [("p", X, (0, 0, 0.8)), ("p", Y, SPACED), ("r", Z, SPACED), ("r", Y, SPACED),
               ("r", Y, (0, 0, 0.4)), ("r", X, (0, 0, 0.3))],
}  # fmt: skip


def urdf(joints: list[Joint], extra: str = "", inertial: bool = True) -> str:
    """An arm with a ball at each joint and velocity and effort limits."""
    mass = (
        '<inertial><origin xyz="0 0 0.05"/><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.02" '
        'ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    ball = '<collision><geometry><sphere radius="0.03"/></geometry></collision>'
    parts = ['<robot name="arm"><link name="base_link"/>']
    parent = "base_link"
    for index, (kind, axis, place) in enumerate([*joints, ("f", Z, (0.0, 0.05, 0.12))]):
        words = [" ".join(map(str, values)) for values in (axis, place)]
        name = "tool0" if kind == "f" else f"link{index}"
        bound = {"r": R, "p": 0.5, "f": 0.0}[kind]
        parts.append(f'<link name="{name}">{mass if inertial else ""}{ball if kind != "f" else ""}</link>')
        parts.append(
            f'<joint name="a{index}" type="{ {"r": "revolute", "p": "prismatic", "f": "fixed"}[kind] }">'
            f'<parent link="{parent}"/><child link="{name}"/><origin xyz="{words[1]}" rpy="0.1 0 0"/>'
            f'<axis xyz="{words[0]}"/><limit lower="{-bound}" upper="{bound}" velocity="1.5" effort="200"/>'
            f"</joint>"
        )
        parent = name
    return "".join([*parts, extra, "</robot>"])


INERTIAL = (
    '<inertial><origin xyz="0 0.01 0.03"/><mass value="0.3"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" '
    'ixy="0" ixz="0" iyz="0"/></inertial>'
)
BOX = '<collision><geometry><box size="0.02 0.02 0.05"/></geometry></collision>'


def link(name: str, parent: str, kind: str, *, range_: str = "-1 1", mimic: str = "", place: str = "0 0 0.1",
         joint: str = "", axis: str = "0 1 0") -> str:  # fmt: skip
    """A link with mass and a box, and the joint above it."""
    low, high = range_.split()
    follow = f"<mimic {mimic}/>" if mimic else ""
    return (
        f'<link name="{name}">{INERTIAL}{BOX}</link><joint name="{joint or name}" type="{kind}">'
        f'<parent link="{parent}"/><child link="{name}"/><origin xyz="{place}" rpy="0.2 -0.3 0.4"/>'
        f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" velocity="1" effort="20"/>{follow}</joint>'
    )
