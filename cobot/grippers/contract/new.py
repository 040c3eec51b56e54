"""`cobot gripper new`: writes a package with a working gripper for a toy device."""

from __future__ import annotations

import re
from importlib.metadata import version
from pathlib import Path

from cobot.grippers.registry import gripper_names
from cobot.launch.new_package import PYPROJECT, check_name, write_package

TOY = Path(__file__).with_name("toy.py")
README = """\
# {name}, a gripper of cobot

```
pip install -e .
cobot gripper list
cobot gripper test {name}
```

Then set `robot.gripper: {{type: {name}}}` in cobot's settings. `{package}.py` drives a toy: replace
`ToyDevice` by your device, as docs/your-gripper.md of cobot describes.
"""


def write_gripper(name: str, parent: Path) -> Path:
    """Create the folder `cobot-gripper-NAME`.

    Args:
        name: gripper type, as in `robot.gripper`.

    Returns:
        The folder.

    Raises:
        ConfigError: the name or the folder cannot be used; nothing has been written.
    """
    check_name(name, gripper_names(), "gripper", "gripper")
    package = f"cobot_gripper_{name}"
    kind = "".join(part.capitalize() for part in name.removesuffix("_gripper").split("_"))
    words = {
        "name": name,
        "distribution": package.replace("_", "-"),
        "package": package,
        "kind": f"{kind}Gripper",
        "group": "grippers",
        "description": f"A gripper of cobot: {name}.",
        "version": version("cobot"),
    }
    toy = TOY.read_text(encoding="utf-8")
    folder = parent / words["distribution"]
    write_package(
        folder,
        {
            "pyproject.toml": PYPROJECT.format(**words),
            "README.md": README.format(**words),
            f"{package}.py": re.sub(r"\bToy(Gripper|Options|Rig)\b", rf"{kind}\1", toy),
        },
    )
    return folder
