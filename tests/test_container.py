"""The Dockerfile and the compose file. Oracles: hadolint, and the compose specification's own models."""

from __future__ import annotations

import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import compose_spec
import pytest
import yaml

ROOT = Path(__file__).parents[1]
HADOLINT = Path(sys.executable).with_name("hadolint")


def instructions(text: str) -> list[tuple[str, str]]:
    """Of a Dockerfile: each instruction and what follows it."""
    lines = [line for line in text.replace("\\\n", " ").splitlines() if line and not line.startswith("#")]
    return [(name, rest.strip()) for name, _, rest in (line.strip().partition(" ") for line in lines)]


@pytest.fixture(scope="module")
def dockerfile() -> list[tuple[str, str]]:
    return instructions((ROOT / "docker" / "Dockerfile").read_text(encoding="utf-8"))


def test_hadolint_has_nothing_to_say() -> None:
    done = subprocess.run(
        [str(HADOLINT), str(ROOT / "docker" / "Dockerfile")], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


def test_what_is_copied_is_let_through_and_is_there(dockerfile: list[tuple[str, str]]) -> None:
    through = {
        line.removeprefix("!")
        for line in (ROOT / "docker" / "Dockerfile.dockerignore").read_text(encoding="utf-8").splitlines()
        if line.startswith("!")
    }
    assert all((ROOT / name).exists() for name in through)
    copied = [shlex.split(rest) for name, rest in dockerfile if name == "COPY" and "--from" not in rest]
    for *sources, _ in copied:
        assert all(source == "." or source in through for source in sources)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    packages = project["tool"]["setuptools"]["packages"]["find"]["include"]
    assert {name for name in packages if "." not in name} <= through
    assert {project["project"]["readme"], *project["project"]["license-files"]} <= through


def test_the_service_runs_as_nobody_in_particular_with_the_settings_of_an_installation(
    dockerfile: list[tuple[str, str]],
) -> None:
    last = dict(dockerfile)
    assert last["USER"] == "990:990"
    assert last["CMD"] == '["run", "--config", "/etc/cobot/cobot-setting.yaml"]'
    assert "/health/live" in last["HEALTHCHECK"]
    assert "--uid 990 --gid 990" in last["RUN"]


def test_the_compose_file_is_one_and_gives_what_a_punctual_cycle_needs() -> None:
    text = (ROOT / "docker" / "compose.yaml").read_text(encoding="utf-8")
    compose_spec.PyCompose.from_yaml(text).to_spec()
    service = yaml.safe_load(text)["services"]["cobot"]
    assert service["shm_size"] == "512m"
    assert service["cap_add"] == ["SYS_NICE", "IPC_LOCK"]
    assert (service["ulimits"]["rtprio"], service["ulimits"]["memlock"]) == (98, -1)
    assert service["network_mode"] == "host"


def test_a_compose_file_that_is_none_would_be_found() -> None:
    text = (ROOT / "docker" / "compose.yaml").read_text(encoding="utf-8").replace("shm_size", "shm_sise")
    with pytest.raises(ValueError, match="shm_sise"):
        compose_spec.PyCompose.from_yaml(text).to_spec()
