"""The distribution cobot-client, in an environment that has nothing but it and what it says that it needs."""

from __future__ import annotations

import json
import zipfile
from email.message import Message
from email.parser import Parser
from pathlib import Path

import httpx
import pytest
from cobot_run import Run
from packaging.requirements import Requirement
from wheels import ROOT, Environment, client_wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return client_wheel(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def files(wheel: Path) -> list[str]:
    with zipfile.ZipFile(wheel) as archive:
        return archive.namelist()


@pytest.fixture(scope="module")
def metadata(wheel: Path, files: list[str]) -> Message:
    (name,) = (each for each in files if each.endswith(".dist-info/METADATA"))
    with zipfile.ZipFile(wheel) as archive:
        return Parser().parsestr(archive.read(name).decode())


@pytest.fixture(scope="module")
def client(wheel: Path, metadata: Message, tmp_path_factory: pytest.TempPathFactory) -> Environment:
    made = Environment(tmp_path_factory.mktemp("client"))
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(made.packages)
    for requirement in metadata.get_all("Requires-Dist", []):
        made.lend(Requirement(requirement))
    return made


def test_it_is_pure_python_for_any_computer(wheel: Path, files: list[str], metadata: Message) -> None:
    assert wheel.name.endswith("-py3-none-any.whl")
    assert not [each for each in files if each.endswith((".so", ".pyx", ".pxd", ".c"))]
    needed = [Requirement(each).name for each in metadata.get_all("Requires-Dist", [])]
    assert sorted(needed) == ["httpx2", "numpy", "websockets"]
    assert metadata["Version"] in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_what_is_in_it_is_the_tree(wheel: Path, files: list[str]) -> None:
    with zipfile.ZipFile(wheel) as archive:
        for name in files:
            if name.endswith(".py"):
                assert archive.read(name) == (ROOT / name.removeprefix("cobot_client/")).read_bytes()


def test_elsewhere_it_reads_moves_streams_and_stops(
    http: httpx.Client, shared: Run, client: Environment
) -> None:
    said = json.loads(
        client.run(ROOT / "tests" / "support" / "program_without_linux.py", shared.url).splitlines()[-1]
    )
    assert {"cobot.client.robot", "cobot.client.rest", "cobot.ipc.layout"} <= set(said["modules"])
    assert said["by name"] == (
        "robot 'iiwa': a name is looked up in shared memory, which exists only on Linux and with the service "
        "installed; use the URL of the service, Robot('http://HOST:8007')"
    )
    assert said["moved"]
    assert said["flange"] == pytest.approx(1.0)
    assert said["streamed"] == pytest.approx(-0.1, abs=0.05)
    assert said["stopped"]
    assert said["rests"]
    assert http.get("/health").json()["robot"]["settled"]
