"""Streams keep away from the scene's objects. Oracle: MuJoCo's own distances at each commanded position."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rig import Rig

from cobot.config import Settings
from cobot.ipc.layout import Command, ServoMode, Stream
from cobot.ipc.stream_writer import PointWriter
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene, SceneFile, SceneObject
from cobot.types import Array, LoopMode
from rtloop.results import LATER
from rtloop.streaming.surroundings import Surroundings

WAY_RAD, WAY_S = 1.0, 4.0
ACROSS = np.array([WAY_RAD, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture
def here(settings: Settings, tmp_path: Path) -> Settings:
    return settings.model_copy(update={"logs": tmp_path})


def ball_ahead(robot: RobotDescription, **fields: object) -> Scene:
    """Where the hand would be after half of the way."""
    home = np.array(robot.positions["home"].joints)
    x, y, z = robot.model.forward(home + 0.5 * ACROSS).position.tolist()
    ball = SceneObject(shape="sphere", size=(0.05,), pose=(x, y, z, 1.0, 0.0, 0.0, 0.0))
    return Scene(version=1, objects={"ball": ball}, **fields)  # type: ignore[arg-type]


def hand_over(rig: Rig, scene: Scene) -> str:
    """As the service does it; "" or why not."""
    SceneFile(rig.settings.scene_file).write(scene)
    return read_anew(rig)


def read_anew(rig: Rig) -> str:
    """Have rtloop read the file, and wait until it has; "" or why not."""
    if refusal := rig.answer(rig.send(Command.SCENE)):
        return refusal
    rig.step()
    rig.await_surroundings()
    rig.step()
    assert not rig.loop.controller.tool_and_scene.surroundings.busy, "the scene was never taken over"
    return ""


def stream_across(rig: Rig) -> Array:
    """Stream the first joint over its way; what was commanded."""
    assert rig.stream(Stream.JOINT_IMPEDANCE, servo_mode=ServoMode.BUFFERED, watchdog_s=0.5) == ""
    writer = PointWriter(rig.memory)
    writer.begin(int(rig.memory.session.data["number"]))
    begun = len(rig.commanded)
    for cycle in range(round(1000 * WAY_S)):
        if rig.mode is not LoopMode.JOINT_IMPEDANCE:
            break
        if cycle % 10 == 0:
            share = min(cycle * 1e-3 / (WAY_S - 0.5), 1.0)
            writer.put(rig.home + (3.0 - 2.0 * share) * share**2 * ACROSS, 0.01, 0.0, 0.0)
        rig.step()
    rig.run()
    return np.array(rig.commanded[begun:])


def nearest(rig: Rig, scene: Scene, rows: Array) -> float:
    """From the ball to any geom that may collide, m."""
    mj = rig.robot.model.among(scene)
    data, ball = mujoco.MjData(mj), mj.body("ball").id
    theirs = [geom for geom in range(mj.ngeom) if mj.geom_bodyid[geom] == ball]
    others = [geom for geom in range(mj.ngeom) if geom not in theirs and mj.geom_contype[geom]]
    pairs = [(geom, other) for geom in theirs for other in others]
    found = np.inf
    for row in rows[::20]:
        data.qpos[:] = row
        mujoco.mj_kinematics(mj, data)
        found = min(found, *(mujoco.mj_geomDistance(mj, data, *pair, 1.0, None) for pair in pairs))
    return float(found)


def test_a_stream_stops_before_an_object_and_names_it(here: Settings, robot: RobotDescription) -> None:
    rig, scene = Rig(here, robot), ball_ahead(robot)
    assert hand_over(rig, scene) == ""
    rows = stream_across(rig)
    assert rig.mode is LoopMode.HOLD
    assert "ball" in rig.reason
    assert 0.0 < nearest(rig, scene, rows) < 0.1
    rig.close()


def others() -> dict[str, dict[str, object]]:
    """A cube of a mesh, of a cloud and of a height field, of 0.1 m, about the origin."""
    corners = tuple((x, y, z) for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (-0.05, 0.05))
    boxes = ((-0.025, 0.0, 0.0, 0.05, 0.1, 0.1), (0.025, 0.0, 0.0, 0.05, 0.1, 0.1))
    return {"mesh": {"hulls": (corners,)}, "point_cloud": {"boxes": boxes}, "height_field": {"boxes": boxes}}


@pytest.mark.parametrize("shape", others())
def test_a_stream_stops_before_other_shapes(here: Settings, robot: RobotDescription, shape: str) -> None:
    rig, scene = Rig(here, robot), ball_ahead(robot)
    fields = {"shape": shape, "size": (0.1, 0.1, 0.1), "pose": scene.objects["ball"].pose, **others()[shape]}
    scene = Scene(version=1, objects={"ball": SceneObject(**fields)})  # type: ignore[arg-type]
    assert hand_over(rig, scene) == ""
    rows = stream_across(rig)
    assert rig.mode is LoopMode.HOLD
    assert "ball" in rig.reason
    assert 0.0 < nearest(rig, scene, rows) < 0.1
    rig.close()


def test_without_it_the_same_stream_goes_through(here: Settings, robot: RobotDescription) -> None:
    rig, scene = Rig(here, robot), ball_ahead(robot)
    assert hand_over(rig, scene) == ""
    assert hand_over(rig, Scene(version=2)) == ""
    rows = stream_across(rig)
    assert rows[:, 0].max() - rig.home[0] > WAY_RAD - 0.01
    assert nearest(rig, scene, rows) < 0.0
    rig.close()


def test_a_restart_keeps_it(here: Settings, robot: RobotDescription) -> None:
    scene = ball_ahead(robot)
    SceneFile(here.scene_file).write(scene)
    rig = Rig(here, robot)
    rig.loop.controller.tool_and_scene.watch_scene()  # as `rtloop.main` does before the first cycle
    rows = stream_across(rig)
    assert "ball" in rig.reason
    assert nearest(rig, scene, rows) > 0.0
    rig.close()


def test_a_scene_is_refused_while_somebody_streams(here: Settings, robot: RobotDescription) -> None:
    rig = Rig(here, robot)
    assert rig.stream(Stream.JOINT_IMPEDANCE) == ""
    assert "a client streams" in hand_over(rig, ball_ahead(robot))
    rig.close()


def test_who_cannot_see_the_scene_does_not_stream(here: Settings, robot: RobotDescription) -> None:
    rig = Rig(here, robot)
    assert hand_over(rig, Scene(version=1)) == ""
    here.scene_file.write_text("{")
    assert read_anew(rig) == ""
    refusal = rig.stream(Stream.JOINT_IMPEDANCE)
    assert "the scene cannot be watched" in refusal
    assert str(here.scene_file) in refusal
    rig.close()


def test_reading_is_not_as_urgent_as_the_cycle(
    here: Settings, robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the kernel's word. SCHED_BATCH is inherited as SCHED_FIFO is, and anybody may have it."""
    seen: list[int] = []
    monkeypatch.setattr(Surroundings, "read", lambda _: seen.append(os.sched_getscheduler(0)))
    surroundings = Surroundings(here, robot.model)

    def cycle() -> None:
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        surroundings.begin()
        while surroundings.take() is LATER:
            time.sleep(1e-3)

    thread = threading.Thread(target=cycle)
    thread.start()
    thread.join()
    assert seen == [os.SCHED_OTHER]
