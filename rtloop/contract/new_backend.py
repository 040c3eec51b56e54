"""`cobot backend new`: creates a distribution with a working backend for a toy device."""

from __future__ import annotations

import re
from importlib.metadata import version
from pathlib import Path

from cobot.launch.new_package import PYPROJECT, check_name, write_package
from rtloop.backends import backend_names

TOY, TRAJECTORY_TOY = (Path(__file__).with_name(name) for name in ("toy.py", "toy_trajectory.py"))
PYTEST = """
[tool.pytest.ini_options]
addopts = "-p rtloop.contract.plugin"
testpaths = ["tests"]
"""
TEST = '''\
"""The contract of cobot's backends, one test for each check. Install this package first: pip install -e ."""

from __future__ import annotations

from collections.abc import Callable

import pytest


@pytest.mark.cobot_backend("{name}")
def test_contract(contract_check: Callable[[], None]) -> None:
    contract_check()
'''
README = """\
# {name}, a backend of cobot

```
pip install -e .
cobot backend list
cobot backend test {name}
```

Then `robot.backend: {name}` in cobot's settings. `{package}.py` drives a toy: put your device in the place of
`ToyDevice`, as docs/your-backend.md of cobot describes.
"""


def write_backend(name: str, parent: Path, *, trajectory: bool = False) -> Path:
    """Make the folder `cobot-backend-NAME`.

    Args:
        name: name of the backend, as in `robot.backend`.
        trajectory: whether the device executes whole motions itself.

    Returns:
        The folder.

    Raises:
        ConfigError: the name or the parent folder cannot be used. Nothing has been written.
    """
    check_name(name, backend_names(), "backend", "arm")
    distribution = f"cobot-backend-{name.replace('_', '-')}"
    package = f"cobot_backend_{name}"
    kind = "".join(part.capitalize() for part in name.removesuffix("_arm").split("_"))
    words = {
        "name": name,
        "distribution": distribution,
        "package": package,
        "kind": f"{kind}Arm",
        "group": "backends",
        "description": f"A backend of cobot for {name}.",
        "version": version("cobot"),
    }
    toy = TRAJECTORY_TOY if trajectory else TOY
    files = {
        "pyproject.toml": PYPROJECT.format(**words) + PYTEST,
        "README.md": README.format(**words),
        f"{package}.py": re.sub(r"\bToy(Arm|Options|Rig)\b", rf"{kind}\1", toy.read_text(encoding="utf-8")),
        "tests/test_contract.py": TEST.format(**words),
    }
    folder = parent / distribution
    write_package(folder, files)
    return folder
