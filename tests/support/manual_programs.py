"""The programs that the manual shows, as they stand there; they are not part of this repository."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping
from pathlib import Path

from folders import ROOT, SUPPORT

FIRST, LAST = "8.0 完整脚本", "8.1 脚本主流程说明"
LUA_FIRST, LUA_LAST = "最小示例如下:", "4. Topic 模块"
SHIM = ROOT / "tests" / "cobot" / "dds" / "rclpy_shim"


def script() -> str | None:
    """The client of section 8.0, if the manual is here."""
    return _between(FIRST, LAST)


def lua_example() -> str | None:
    """The example of chapter 3, if the manual is here."""
    return _between(LUA_FIRST, LUA_LAST)


def _between(first: str, last: str) -> str | None:
    for path in sorted((ROOT.parent / "shared" / "spec").glob("*.txt")):
        text = path.read_text(encoding="utf-8")
        if first in text:
            return text.split(first, 1)[1].split(last, 1)[0].strip() + "\n"
    return None


def run_script(
    folder: Path, *arguments: str, python: str, environment: Mapping[str, str]
) -> subprocess.CompletedProcess[str]:
    """Run it in a process of its own, not on a terminal."""
    path = folder / "client.py"
    text = script()
    assert text is not None
    path.write_text(text, encoding="utf-8")
    return subprocess.run(
        [python, str(path), *arguments],
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=200.0,
        check=False,
    )


def shim_environment(domain: int, *, localhost_only: bool = True) -> dict[str, str]:
    """For our `rclpy` on Fast DDS, which takes the place of ROS."""
    paths = [str(SHIM), str(SUPPORT), str(ROOT)]
    return os.environ | {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_LOCALHOST_ONLY": str(int(localhost_only)),
        "PYTHONPATH": os.pathsep.join([*paths, *filter(None, [os.environ.get("PYTHONPATH")])]),
    }
