"""Episodes as files. Oracle: what was written; rosbags' own types; PNG's specification through Pillow."""

from __future__ import annotations

import io
import struct
import time
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from cobot.client.states import GripperReading
from cobot.config import Settings
from cobot.errors import InputError
from cobot.ipc.layout import GripperObject
from cobot.learning.__main__ import main
from cobot.learning.cameras import CAMERAS, FRONT, Camera, Renderer
from cobot.learning.episodes import EpisodeWriter, read_episode
from cobot.learning.png import SIGNATURE, pixels_of_png
from cobot.learning.record import record
from cobot.learning.simulation import Simulation
from cobot.recording import bounds
from cobot.robot.description import RobotDescription
from cobot.robot.geometry.rays import png

NAMES = ["joint1", "joint2"]
RANDOM = np.random.default_rng(2)
PICTURE = RANDOM.integers(0, 255, (6, 8, 3), np.uint8)


@pytest.fixture
def simulation(settings: Settings, robot: RobotDescription) -> Iterator[Simulation]:
    made = Simulation(settings, robot, np.array(robot.positions["home"].joints))
    yield made
    made.close()


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    with EpisodeWriter(path, NAMES, 10.0, task="wave", robot="iiwa") as episode:
        for frame in range(5):
            episode.add(100.0 + 0.1 * frame, [frame, 0.0], [1.0, 2.0], [frame + 1.0, 0.0], {"front": PICTURE})
        episode.finish(success=True, seed="3")
    found = read_episode(path)
    assert found.about["task"] == "wave"
    assert (found.about["success"], found.about["seed"], found.about["frames"]) == ("true", "3", "5")
    assert (found.joint_names, found.rate_hz) == (NAMES, 10.0)
    assert found.times_s == pytest.approx(100.0 + 0.1 * np.arange(5))
    assert found.position[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert found.action[:, 0].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert found.velocity[3].tolist() == [1.0, 2.0]
    assert found.pictures["front"].shape == (5, 6, 8, 3)
    assert (found.pictures["front"][4] == PICTURE).all()


def test_the_gripper_of_each_frame_is_read_as_it_was_written(tmp_path: Path) -> None:
    """Oracles: what was written; rosbags, with what the file itself says of the type."""
    path = tmp_path / "one.mcap"
    readings = [
        GripperReading(0.08, float("nan"), 0.0, moving=True, object=GripperObject.NONE),
        GripperReading(0.05, 0.04, 40.0, moving=False, object=GripperObject.HELD_INSIDE),
    ]
    with EpisodeWriter(path, NAMES, 10.0) as episode:
        for frame, reading in enumerate(readings):
            episode.add(0.1 * frame, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], gripper=reading)
    assert [str(each) for each in read_episode(path).gripper] == [str(each) for each in readings]
    with AnyReader([path]) as reader:
        connections = [each for each in reader.connections if each.topic == "/gripper"]
        seen = [reader.deserialize(raw, each.msgtype) for each, _, raw in reader.messages(connections)]
    assert [each.gripper_width for each in seen] == [0.08, 0.05]
    assert seen[1].gripper_object == seen[1].OBJECT_HELD_INSIDE


def test_a_gripper_in_some_frames_alone_is_no_whole_episode(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    reading = GripperReading(0.08, 0.08, 0.0, moving=False, object=GripperObject.NONE)
    with EpisodeWriter(path, NAMES, 10.0) as episode:
        for frame in range(2):
            episode.add(frame, [0, 0], [0, 0], [0, 0], gripper=reading if frame else None)
    with pytest.raises(InputError, match="its topics have different lengths"):
        read_episode(path)


def test_an_episode_that_breaks_off_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"

    def broken_off() -> None:
        with EpisodeWriter(path, NAMES, 10.0) as episode:
            episode.add(0.0, [0, 0], [0, 0], [0, 0])
            raise InterruptedError

    with pytest.raises(InterruptedError):
        broken_off()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [b"", b"nothing of the kind", b"\x89MCAP0\r\n" * 3])
def test_what_is_no_episode_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "one.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"one\.mcap: is not a complete episode"):
        read_episode(path)
    with pytest.raises(InputError, match="No such file"):
        read_episode(tmp_path / "two.mcap")


def test_wrong_frames_and_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"must end with \.mcap"):
        EpisodeWriter(tmp_path / "one.bag", NAMES, 10.0)
    with pytest.raises(InputError, match="rate_hz must be above 0"):
        EpisodeWriter(tmp_path / "one.mcap", NAMES, 0.0)
    with EpisodeWriter(tmp_path / "one.mcap", NAMES, 10.0) as episode:
        with pytest.raises(InputError, match="action"):
            episode.add(0.0, [0, 0], [0, 0], [0])
        with pytest.raises(InputError, match="picture 'front': must be uint8"):
            episode.add(0.0, [0, 0], [0, 0], [0, 0], {"front": PICTURE.astype(float)})
        episode.abandon()


def test_pictures_are_png() -> None:
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    content = png(PICTURE)
    with image.open(io.BytesIO(content)) as opened:
        assert (np.asarray(opened.convert("RGB")) == PICTURE).all()
    assert (pixels_of_png(content) == PICTURE).all()
    for wrong in (b"", content[:40], content[:-20] + bytes(20), content.replace(b"IDAT", b"IDAX")):
        with pytest.raises(ValueError, match="a picture in it is"):
            pixels_of_png(wrong)


def test_a_picture_in_a_million_pieces_is_read_as_quickly_as_in_one() -> None:
    """Empty and tiny IDAT chunks, which PNG permits: each costs what it has, not what came before it."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", 700, 700, 8, 2, 0, 0, 0)
    pixels = RANDOM.integers(0, 255, (700, 700, 3), np.uint8)
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    data = zlib.compress(rows, 0)
    pieces = b"".join(chunk(b"IDAT", data[at : at + 2]) for at in range(0, len(data), 2))
    content = SIGNATURE + chunk(b"IHDR", head) + pieces + chunk(b"IEND", b"")
    begin_s = time.process_time()
    assert (pixels_of_png(content) == pixels).all()
    assert time.process_time() - begin_s < 15.0  # 1 s; 300 GB are copied where each piece copies all before


def test_pictures_that_are_small_alone_are_bounded_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A black picture of 3 MB has 3 kB as PNG: a small file of many would fill the memory."""
    path = tmp_path / "one.mcap"
    black = np.zeros((1000, 1000, 3), np.uint8)
    with EpisodeWriter(path, NAMES, 10.0) as episode:
        for number in range(4):
            episode.add(0.1 * number, [0, 0], [0, 0], [0, 0], {"front": black})
    assert path.stat().st_size < 100_000
    monkeypatch.setattr(bounds.os, "sysconf", {"SC_PAGE_SIZE": 1, "SC_PHYS_PAGES": 30_000_000}.__getitem__)
    with pytest.raises(
        InputError, match="the pictures of the file claim 18000000 bytes uncompressed, but only 15000000 fit"
    ):
        read_episode(path)


def test_an_arm_is_recorded_as_it_is_moved(
    simulation: Simulation, robot: RobotDescription, tmp_path: Path
) -> None:
    from cobot.client import Mode

    simulation.robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
    control = simulation.robot.start_joint_impedance_control(30, interpolation="quintic")
    home = control.get_state().q
    tiny = Camera("tiny", FRONT.eye, FRONT.target, width=8, height=6)
    sent = 0

    def sending() -> bool:
        nonlocal sent
        sent += 1
        control.set_target_joints([home[0] + 0.01 * sent, *home[1:]])
        return sent > 20

    frames = record(
        simulation.robot,
        list(robot.limits.names),
        tmp_path / "one.mcap",
        seconds=10.0,
        task="turn",
        renderer=Renderer(robot, (tiny,)),
        ended=sending,
        clock=simulation.clock,
    )
    found = read_episode(tmp_path / "one.mcap")
    assert frames == len(found.times_s) == 20
    assert np.diff(found.times_s) == pytest.approx(np.full(19, 1 / 30), abs=1.1e-3)
    assert (np.diff(found.position[3:, 0]) > 0.0).all()
    assert found.action[12:, 0] == pytest.approx(home[0] + 0.01 * np.arange(13, 21), abs=0.02)
    assert found.pictures["tiny"].shape == (20, 6, 8, 3)


def test_cameras_see_the_arm_where_it_is(robot: RobotDescription) -> None:
    home = np.array(robot.positions["home"].joints)
    renderer = Renderer(robot, list(CAMERAS.values()))
    seen = renderer.render(home)
    assert {name: picture.shape for name, picture in seen.items()} == {
        "front": (72, 96, 3),
        "wrist": (72, 96, 3),
    }
    orange = (seen["front"][:, :, 0] > 100) & (seen["front"][:, :, 2] < 60)
    assert 100 < orange.sum() < 3000, "the arm, and not the whole picture"
    turned = renderer.render(home + np.eye(7)[0])
    assert not (turned["front"] == seen["front"]).all()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"name": "a b"}, "letters, digits"),
        ({"width": 0}, "0 x 72 pixels"),
        ({"view_rad": 4.0}, "view_rad must be 0.01 to 3"),
        ({"eye": (0.0, 0.0, 0.0)}, "up must not be parallel to the viewing direction"),
        ({"mounted": "hand"}, "mounted must be base or tcp"),
        ({"target": (0.0, float("nan"), 0.0)}, "target must be 3 finite numbers"),
    ],
)
def test_cameras_that_cannot_be_are_named(options: dict[str, object], said: str) -> None:
    right = {"name": "one", "eye": (1.0, 0.0, 0.0), "target": (0.0, 0.0, 0.0)}
    with pytest.raises(InputError, match=said):
        Camera(**{**right, **options})  # type: ignore[arg-type]


def test_the_command_says_what_it_lacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["record", str(tmp_path / "one.mcap"), "--cameras", "left"]) == 1
    assert "there is no camera 'left'; valid names: front, wrist" in capsys.readouterr().err
