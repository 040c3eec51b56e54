"""`cobot record`, `cobot plot` and `cobot replay`: recordings on the command line, see docs/recording.md."""

from __future__ import annotations

import argparse
import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cobot.client.rest import Client
from cobot.commands.options import url_of
from cobot.errors import ConfigError
from cobot.recording.plot import svg_of
from cobot.recording.reader import read_recording
from cobot.recording.replay import csv_of, points_of

EVERY_S = 0.02


def run(chosen: argparse.Namespace) -> None:
    """Execute the command.

    Raises:
        CobotError: the service rejects the request, or the file cannot be used.
    """
    match chosen.command:
        case "plot":
            _plot(chosen.file, chosen.output or chosen.file.with_suffix(".svg"))
        case "replay":
            _replay(chosen)
        case _:
            _record(chosen)


def _record(chosen: argparse.Namespace) -> None:
    with _client(chosen) as client:
        if chosen.action == "list":
            for each in client.recordings()["recordings"]:
                print(f"{each['time']}  {each['reason']:10}  {each['size'] / 1e6:8.1f} MB  {each['name']}")
            return
        if chosen.action == "get":
            names = [chosen.name]
        else:
            names = client.record(chosen.action, getattr(chosen, "seconds", None))
        output = getattr(chosen, "output", None)
        for name in names:
            if output is None:
                print(name)
            else:
                client.fetch_recording(name, output / name)
                print(output / name)


def _plot(file: Path, output: Path) -> None:
    _write(output, svg_of(read_recording(file)))
    print(output)


def _replay(chosen: argparse.Namespace) -> None:
    times_s, positions = points_of(read_recording(chosen.file), EVERY_S, measured=chosen.measured)
    content = csv_of(times_s, positions)
    if chosen.csv is not None:
        _write(chosen.csv, content)
        print(f"{chosen.csv}: {len(times_s)} points, {times_s[-1]:.2f} s")
        return
    options: dict[str, Any] = {"move_to_start": chosen.move_to_start, "retime": True}
    if chosen.smoothing_rad is not None:
        options["smoothing_rad"] = chosen.smoothing_rad
    with tempfile.TemporaryDirectory() as folder, _client(chosen) as client:
        points = Path(folder) / f"{chosen.file.stem}.csv"
        _write(points, content)
        sent = client.send_csv(points, **options)
    print(f"motion {sent['motion_id']}: {sent['points']} points, {sent['duration_s']:.2f} s")
    if sent["note"]:
        print(sent["note"])


@contextlib.contextmanager
def _client(chosen: argparse.Namespace) -> Iterator[Client]:
    verify = True if chosen.certificate is None else chosen.certificate
    with Client(
        url_of(chosen), robot=chosen.robot, token=chosen.token, verify=verify, timeout_s=150.0
    ) as client:
        yield client


def _write(path: Path, content: str) -> None:
    try:
        path.write_text(content, encoding="utf-8")
    except OSError as exc:
        raise ConfigError(f"{path}: {exc.strerror}") from exc
