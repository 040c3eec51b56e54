"""SyncMove's frames.

Oracle: pinocchio's SE3, composed along the tree that the test keeps itself.
"""

from __future__ import annotations

import random
from types import SimpleNamespace

import numpy as np
import pinocchio
from vendor_calls import Caller, run

from app.services.motion.synchronous import SyncService
from cobot.codes import Code

CLASS = "SyncMove"


def se3(pose: list[float]) -> pinocchio.SE3:
    return pinocchio.SE3(pinocchio.rpy.rpyToMatrix(*pose[3:]), np.array(pose[:3]))


def random_pose(dice: random.Random) -> list[float]:
    return [dice.uniform(-2.0, 2.0) for _ in range(3)] + [dice.uniform(-1.5, 1.5) for _ in range(3)]


def asking() -> Caller:
    return Caller(SimpleNamespace(sync=SyncService()), CLASS)


class Tree:
    """The same frames in pinocchio."""

    def __init__(self) -> None:
        self.parents: dict[str, str] = {}
        self.poses: dict[str, pinocchio.SE3] = {}

    def world(self, name: str) -> pinocchio.SE3:
        if name == "world":
            return pinocchio.SE3.Identity()
        return self.world(self.parents[name]) * self.poses[name]

    def below(self, name: str, above: str) -> bool:
        return name == above or (name != "world" and self.below(self.parents[name], above))


def test_a_random_tree_is_where_pinocchio_puts_it() -> None:
    async def check() -> None:
        ask, dice, tree = asking(), random.Random(11), Tree()
        for index in range(30):
            name, parent, pose = f"f{index}", dice.choice(["world", *tree.poses]), random_pose(dice)
            await ask("frameAdd", name=name, pose=pose, ref_frame=parent)
            tree.parents[name], tree.poses[name] = parent, se3(pose)
        refused = 0
        for _ in range(200):
            name, other = dice.choice(list(tree.poses)), dice.choice(["world", *tree.poses])
            circle = tree.below(other, name)
            refused += circle
            if dice.random() < 0.5:
                if circle:
                    await ask.fails("frameAttach", Code.CONFLICT, frame=name, ref_frame=other)
                else:
                    await ask("frameAttach", frame=name, ref_frame=other)
                    tree.poses[name] = tree.world(other).inverse() * tree.world(name)
                    tree.parents[name] = other
            elif circle:
                await ask.fails(
                    "frameMove", Code.CONFLICT, name=name, pose=random_pose(dice), ref_frame=other
                )
            else:
                pose = random_pose(dice)
                await ask("frameMove", name=name, pose=pose, ref_frame=other)
                tree.poses[name] = tree.world(tree.parents[name]).inverse() * tree.world(other) * se3(pose)
        assert refused > 5
        for _ in range(200):
            name, other = (dice.choice(["world", *tree.poses]) for _ in range(2))
            wanted = tree.world(other).inverse() * tree.world(name)
            found = se3(await ask("frameGetPose", name=name, ref_frame=other))
            np.testing.assert_allclose(found.homogeneous, wanted.homogeneous, atol=1e-9)
            pose = random_pose(dice)
            seen = se3(await ask("frameConvertPose", from_frame=name, to_frame=other, pose=pose))
            np.testing.assert_allclose(seen.homogeneous, (wanted * se3(pose)).homogeneous, atol=1e-9)
        for name, parent in tree.parents.items():
            assert await ask("frameGetParent", name=name) == parent
            children = [child for child, above in tree.parents.items() if above == name]
            assert sorted(await ask("frameGetChildren", name=name)) == sorted(children)

    run(check())


def test_a_frame_is_deleted_only_when_none_hangs_on_it() -> None:
    async def check() -> None:
        ask, pose = asking(), [0.0] * 6
        await ask("frameAdd", name="table", pose=pose, ref_frame="")
        await ask("frameAdd", name="part", pose=pose, ref_frame="table")
        assert "part are attached" in await ask.fails("frameDelete", Code.CONFLICT, name="table")
        await ask("frameDelete", name="part")
        await ask("frameDelete", name="table")
        assert await ask("frameGetNames") == ["world"]
        await ask("frameAdd", name="table", pose=pose, ref_frame="")
        await ask("frameDeleteAll")
        assert await ask("frameGetNames") == ["world"]

    run(check())


def test_what_cannot_be_is_refused() -> None:
    async def check() -> None:
        ask, pose = asking(), [0.0] * 6
        await ask("frameAdd", name="table", pose=pose)
        await ask.fails("frameAdd", Code.CONFLICT, name="table", pose=pose)
        await ask.fails("frameAdd", Code.CONFLICT, name="world", pose=pose)
        await ask.fails("frameAdd", Code.INPUT, name="", pose=pose)
        await ask.fails("frameAdd", Code.INPUT, name="short", pose=[0.0])
        message = await ask.fails("frameAdd", Code.NOT_FOUND, name="x", pose=pose, ref_frame="nowhere")
        assert "valid names: world, table" in message
        await ask.fails("frameGetPose", Code.NOT_FOUND, name="nowhere")
        await ask.fails("frameAttach", Code.CONFLICT, frame="table", ref_frame="table")
        await ask.fails("frameMove", Code.INPUT, name="world", pose=pose)

    run(check())
