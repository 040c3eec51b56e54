"""A wheel runs outside the checkout, with nothing of it, and beside that of the client alone."""

from __future__ import annotations

import os
import shutil
import zipfile
from pathlib import Path

import pytest
from cobot_run import Run, answering
from wheels import Environment, build, client_wheel

ROOT = Path(__file__).parents[2]
# With what is compiled already: the wheel has to be whole, not new.
SOURCES = ("cobot", "rtloop", "app", "config", "sequences", "build")
FILES = ("pyproject.toml", "setup.py", "requirements/build.lock", "README.md", "LICENSE")
# Where nothing is compiled yet, all of it is.
pytestmark = [pytest.mark.thorough, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That of this checkout."""
    copy = tmp_path_factory.mktemp("copy")
    for name in SOURCES:
        if (ROOT / name).exists():
            unread = shutil.ignore_patterns("__pycache__", "lib", "bdist.*", "sanitized")
            shutil.copytree(ROOT / name, copy / name, ignore=unread)
    for name in FILES:
        shutil.copy2(ROOT / name, copy)
    made = build(copy, tmp_path_factory.mktemp("wheel"))
    shutil.rmtree(copy)
    return made


@pytest.fixture
def installed(wheel: Path, tmp_path: Path) -> Path:
    """The folder that the wheel was unpacked into."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    return tmp_path / "installed"


def stems(folder: Path, last_names: str) -> set[Path]:
    """The compiled modules there, or what they are made from, without their last names."""
    found = {each for name in SOURCES[:3] for each in (folder / name).rglob(last_names)}
    return {each.relative_to(folder).with_name(each.name.split(".")[0]) for each in found}


def test_a_wheel_runs_outside_the_checkout(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert stems(installed, "*.so") == stems(ROOT, "*.pyx")
    site = Path("app", "panel", "site")
    assert sorted(os.listdir(installed / site)) == sorted(os.listdir(ROOT / site))
    assert (installed / "cobot" / "studies" / "results" / "map_page.html").is_file()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(installed))
    with answering(Run(tmp_path)) as run:
        for module in ("rtloop", "app"):
            process = run.child(module)
            assert process is not None
            loaded = [Path(each.path) for each in process.memory_maps() if ".so" in each.path]
            assert not any(each.is_relative_to(ROOT / package) for each in loaded for package in SOURCES)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return client_wheel(tmp_path_factory.mktemp("client"))


def whole(wheel: Path, environment: Environment) -> bool:
    """Whether all of a wheel is installed, as it is in the wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return all(
            (environment.packages / name).read_bytes() == archive.read(name)
            for name in archive.namelist()
            if not name.endswith("/RECORD")
        )


@pytest.mark.parametrize("client_first", [True, False])
def test_beside_the_client_each_stays_whole(
    wheel: Path, client: Path, tmp_path: Path, client_first: bool
) -> None:
    """The one that came first goes first, too: its files must not have become those of the other."""
    environment = Environment(tmp_path / "environment")
    first, second = (client, wheel) if client_first else (wheel, client)
    environment.install(first, second)
    assert whole(first, environment)
    assert whole(second, environment)
    place = ["-c", "import cobot; print(cobot.__path__[0])"]
    assert environment.run(*place) == str(environment.packages / "cobot")
    environment.pip("uninstall", "--yes", first.name.partition("-")[0])
    assert whole(second, environment)
    left = environment.packages / ("cobot" if client_first else "cobot_client/cobot")
    assert environment.run(*place) == str(left)
