"""Where the service keeps its files."""

from __future__ import annotations

from pathlib import Path

from cobot.config import Settings, load_settings


def settings_of(folder: Path, text: str) -> Settings:
    path = folder / "settings.yaml"
    path.write_text(text, encoding="utf-8")
    return load_settings(path)


def test_scene_and_tool_are_kept_where_the_settings_say_and_else_beside_the_log(tmp_path: Path) -> None:
    settings = settings_of(tmp_path, "logs: logs\n")
    assert settings.scene_file.parent == settings.tool_file.parent == tmp_path / "logs"
    settings = settings_of(tmp_path, "logs: logs\nkept: things\n")
    assert settings.scene_file.parent == settings.tool_file.parent == tmp_path / "things"
    assert settings.log_file.parent == tmp_path / "logs"
