"""The shipped settings of the FR3, as `cobot run --config` reads them."""

from __future__ import annotations

import tempfile
from pathlib import Path

import yaml
from folders import ROOT

from cobot.config import Settings, load_settings

FR3 = ROOT / "config" / "fr3.yaml"


def franka_settings(**options: object) -> Settings:
    """With options they are those of a robot at an address, without they are simulated."""
    if not options:
        return load_settings(FR3)
    content = yaml.safe_load(FR3.read_text(encoding="utf-8"))
    content["robot"]["backend"] = {"type": "franka", **options}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "fr3.yaml"
        file.write_text(yaml.safe_dump(content), encoding="utf-8")
        return load_settings(file)
