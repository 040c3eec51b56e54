"""An arm with every shape: turned axes, joints beside their bodies' origins, a slide, two branches."""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.types import Array

SEED = 20261122
STANDING = 3
"""The number of geoms that stand around it."""
ARM = """<mujoco>
<asset><mesh name="cube" vertex="0 0 0  .2 0 0  0 .2 0  0 0 .2  .2 .2 0  .2 0 .2  0 .2 .2  .2 .2 .2"/></asset>
<worldbody>
<geom type="plane" size="1 1 1" pos="0 0 -.6" quat="1 .1 .2 0"/>
<geom type="box" size=".1 .2 .3" pos=".6 .5 .1" quat="1 .5 .2 .3"/>
<geom type="cylinder" size=".2 .1" pos="-.6 .4 .1" quat="1 .1 .2 .3"/>
{}{}
</worldbody></mujoco>"""
GEOMS = (
    'type="capsule" size=".05 .1"',
    'type="sphere" size=".07"',
    'type="cylinder" size=".05 .1"',
    'type="box" size=".05 .1 .02"',
    'type="ellipsoid" size=".05 .1 .07"',
    'type="mesh" mesh="cube"',
)


def odd_arm(around: str = "") -> mujoco.MjModel:
    """Turned axes, joints beside their bodies' origins, a slide, two joints in one body, two branches.

    Args:
        around: further geoms that stand, from index `STANDING` on.
    """
    random = np.random.default_rng(SEED)

    def body(geom: str, kind: str = "hinge", more: str = "") -> str:
        pos, quat, axis, at = random.uniform(-0.2, 0.2, 3), *(random.normal(size=n) for n in (4, 3, 3))
        words = [" ".join(map(str, values)) for values in (pos, quat, axis, 0.05 * at)]
        return (
            f'<body pos="{words[0]}" quat="{words[1]}"><joint type="{kind}" axis="{words[2]}" '
            f'pos="{words[3]}" ref="0.1" range="-.3 .3"/>{more}<geom {geom} pos=".1 0 .05"/>'
        )

    first, second, third, fourth, fifth, sixth = GEOMS
    return mujoco.MjModel.from_xml_string(
        ARM.format(
            around,
            body(first)
            + body(second, "slide")
            + body(third, more='<joint axis="0 1 0"/>')
            + "</body>"
            + body(fourth)
            + body(fifth)
            + body(sixth)
            + "</body>" * 5,
        )
    )


def by_mujoco(mj: mujoco.MjModel, joints: Array, pairs: list[tuple[int, int]]) -> Array:
    data = mujoco.MjData(mj)
    data.qpos[:] = joints
    mujoco.mj_kinematics(mj, data)
    return np.array([mujoco.mj_geomDistance(mj, data, *pair, 5.0, None) for pair in pairs])
