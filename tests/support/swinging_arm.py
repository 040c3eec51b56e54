"""An arm of two links in a vertical plane, on a joint that turns it about the vertical: what it weighs on its
drives can be calculated by hand.
"""

from __future__ import annotations

GRAVITY = 9.81
MASSES, LENGTH, CENTRE = (4.0, 2.0), 0.5, 0.25
"""Masses of the upper and the lower link, kg; the length of both, and the distance of their centres, m."""
SHOULDER = GRAVITY * (MASSES[0] * CENTRE + MASSES[1] * (LENGTH + CENTRE))
ELBOW = GRAVITY * MASSES[1] * CENTRE
"""What the drives need at most to hold it, N·m: stretched out level."""
LEVEL = [0.0, 1.5707963, 0.0]
UPRIGHT = [0.0, 0.0, 0.0]


def swinging_arm(efforts: tuple[float, float, float] = (50.0, 50.0, 50.0), dynamics: str = "") -> str:
    """Its URDF; at 0 it stands upright. `dynamics` is an element of the shoulder."""
    parts = ['<robot name="swing"><link name="base"/>']
    names, parents = ("turn", "shoulder", "elbow"), ("base", "post", "upper")
    for index, (joint, parent, link) in enumerate(
        zip(names, parents, ("post", "upper", "lower"), strict=True)
    ):
        mass, centre = (1.0, 0.0) if index == 0 else (MASSES[index - 1], CENTRE)
        parts.append(
            f'<link name="{link}"><inertial><origin xyz="0 0 {centre}"/><mass value="{mass}"/><inertia '
            'ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin '
            f'xyz="0 0 {centre}"/><geometry><sphere radius="0.05"/></geometry></collision></link>'
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="0 0 {(0.2, 0.2, LENGTH)[index]}"/>'
            f'<axis xyz="{"0 0 1" if index == 0 else "0 1 0"}"/>'
            f'<limit lower="-2.5" upper="2.5" velocity="2" effort="{efforts[index]}"/>'
            f"{dynamics if joint == 'shoulder' else ''}</joint>"
        )
    parts.append(
        f'<link name="tool0"/><joint name="end" type="fixed"><parent link="lower"/><child link="tool0"/>'
        f'<origin xyz="0 0 {LENGTH}"/></joint></robot>'
    )
    return "".join(parts)
