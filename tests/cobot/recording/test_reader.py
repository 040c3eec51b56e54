"""A recording read again, drawn and made a trajectory.

Oracles: the values that were written; the XML parser; the service's own reader of CSV.
"""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_cycles import Cycles, stepped

from app.services.motion.csv_points import read_points
from cobot.config import Settings
from cobot.errors import InputError
from cobot.launch.cli import main
from cobot.recording import reader
from cobot.recording.plot import svg_of
from cobot.recording.reader import read_recording
from cobot.recording.replay import csv_of, points_of
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode

DOF = 7


@pytest.fixture(scope="module")
def recorded(
    settings: Settings, robot: RobotDescription, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Path, Cycles]]:
    """A recording of two modes, and what was written."""
    cycles = Cycles(settings, robot, tmp_path_factory.mktemp("recorded"))
    recorder = cycles.recorder()
    cycles.write(400)
    cycles.write(600, LoopMode.TRAJECTORY, "<a & b>")
    recorder.ask({"action": "dump", "seconds": 0.9})
    stepped(recorder)
    (name,) = cycles.names()
    yield cycles.folder / name, cycles
    cycles.close()


def moving(path: Path) -> reader.Cycles:
    """The same as if the arm had moved smoothly between rests."""
    cycles = read_recording(path)
    share = np.clip((cycles.times_s - 0.2) / 0.5, 0.0, 1.0)
    smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return replace(cycles, commanded=smooth[:, None] * np.linspace(-0.4, 0.4, DOF))


def test_what_was_written_is_read(recorded: tuple[Path, Cycles]) -> None:
    path, cycles = recorded
    found = read_recording(path)
    written = cycles.written[100:1000]
    measured = np.array([each["measured"][: 5 * DOF].reshape(5, DOF) for each in written])
    np.testing.assert_array_equal(found.position, measured[:, 0])
    np.testing.assert_array_equal(found.velocity, measured[:, 1].astype(np.float32))
    np.testing.assert_array_equal(found.effort, measured[:, 2].astype(np.float32))
    np.testing.assert_array_equal(found.commanded, [each["command"][0] for each in written])
    np.testing.assert_allclose(found.times_s, np.arange(900) * 0.001)
    assert found.modes.tolist() == [LoopMode.HOLD] * 300 + [LoopMode.TRAJECTORY] * 600
    assert (found.robot, found.missing, found.reason) == (cycles.settings.robot.name, 0, "request")
    assert [(each.kind, each.mode, each.text) for each in found.events] == [
        ("mode", "HOLD", ""),
        ("mode", "TRAJECTORY", "<a & b>"),
    ]
    assert found.events[1].time_s == pytest.approx(0.3)


def test_some_cycles_are_where_the_arm_was(
    recorded: tuple[Path, Cycles], monkeypatch: pytest.MonkeyPatch
) -> None:
    every = read_recording(recorded[0])
    found = reader.read_path(recorded[0], 10)
    chosen = np.linspace(0, 899, 10).round().astype(int)
    np.testing.assert_allclose(found.times_s, every.times_s[chosen], atol=1e-9)
    np.testing.assert_array_equal(found.joints, every.position[chosen])
    np.testing.assert_array_equal(found.velocities, every.velocity[chosen])
    assert [(each.kind, each.text) for each in found.events] == [
        (each.kind, each.text) for each in every.events
    ]
    assert [each.time_s for each in found.events] == pytest.approx([each.time_s for each in every.events])
    assert len(reader.read_path(recorded[0], 1000).times_s) == 900
    monkeypatch.setattr(reader, "MAX_SHOWN_BYTES", 1000)
    with pytest.raises(InputError, match="use cobot plot for this file"):
        reader.read_path(recorded[0], 10)


@pytest.mark.parametrize("cut", [0, 5, 100, 0.5, -1])
def test_a_damaged_file_is_refused_with_its_name(
    recorded: tuple[Path, Cycles], tmp_path: Path, cut: float
) -> None:
    content = recorded[0].read_bytes()
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(content[: int(cut * len(content)) if isinstance(cut, float) else cut])
    with pytest.raises(InputError, match=r"damaged\.mcap: is not a complete recording"):
        read_recording(damaged)
    with pytest.raises(InputError, match="No such file"):
        read_recording(tmp_path / "none.mcap")


def test_a_drawing_is_xml_and_has_a_line_for_each_joint_in_each_chart(
    recorded: tuple[Path, Cycles], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    output = tmp_path / "out.svg"
    assert main(["plot", str(recorded[0]), "--output", str(output)]) == 0
    assert capsys.readouterr().out.strip() == str(output)
    root = ET.fromstring(output.read_text(encoding="utf-8"))
    space = "{http://www.w3.org/2000/svg}"
    assert len(root.findall(f"{space}polyline")) == 4 * DOF
    texts = [each.text or "" for each in root.iter(f"{space}text")]
    for word in ("position, rad", "velocity, rad/s", "torque, N·m", "HOLD", "TRAJECTORY", "joint1", "joint7"):
        assert word in texts
    assert any("<a & b>" in (each.text or "") for each in root.iter(f"{space}title"))
    for line in root.findall(f"{space}polyline"):
        points = np.array([point.split(",") for point in line.attrib["points"].split()], dtype=float)
        assert np.isfinite(points).all()
        assert (np.diff(points[:, 0]) >= 0.0).all()


def test_a_long_line_is_drawn_with_its_extremes(recorded: tuple[Path, Cycles]) -> None:
    short = read_recording(recorded[0])
    n = 50_000
    values = np.zeros((n, DOF))
    values[31_007] = 1.0
    drawing = svg_of(
        replace(
            short,
            times_s=np.arange(n) * 0.001,
            position=values,
            velocity=values,
            effort=values,
            commanded=values,
            modes=np.zeros(n, int),
        )
    )
    assert len(drawing) < 2_000_000
    assert f"{1000 * 31.007 / 49.999 + 70:.1f},60.0" in drawing


def test_points_are_those_of_the_motion_without_the_rests(recorded: tuple[Path, Cycles]) -> None:
    cycles = moving(recorded[0])
    times_s, positions = points_of(cycles, 0.02)
    assert times_s[0] == 0.0
    assert 0.4 < times_s[-1] <= 0.502
    np.testing.assert_allclose(np.diff(times_s)[:-1], 0.02, atol=1e-9)
    np.testing.assert_allclose(positions[-1], np.linspace(-0.4, 0.4, DOF), atol=2e-4)
    read = read_points(
        io.BytesIO(csv_of(times_s, positions).encode()),
        None,
        [f"joint{n}" for n in range(1, DOF + 1)],
        lambda point: None,
    )
    np.testing.assert_allclose([each.positions for each in read], positions, atol=1e-9)
    np.testing.assert_allclose([each.time_from_start_s for each in read], times_s, atol=1e-9)


def test_a_recording_without_a_motion_or_with_a_gap_is_not_replayed(recorded: tuple[Path, Cycles]) -> None:
    cycles = moving(recorded[0])
    with pytest.raises(InputError, match="no joint moves"):
        points_of(replace(cycles, commanded=np.ones_like(cycles.commanded)), 0.02)
    with pytest.raises(InputError, match="3 cycles are missing"):
        points_of(replace(cycles, missing=3), 0.02)
