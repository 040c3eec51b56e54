"""Names of files that clients give. Oracle: os.path and the file system itself."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from cobot.errors import InputError
from cobot.folders import below


@pytest.mark.parametrize("name", ["a.json", "sub/b.lua", "sub/../a.json", "no such file"])
def test_what_is_below_the_folder_is_found_whether_it_is_there_or_not(tmp_path: Path, name: str) -> None:
    folder = tmp_path.resolve()
    (folder / "sub").mkdir()
    assert str(below(folder, name, "program", "programs folder")) == os.path.normpath(folder / name)


@pytest.mark.parametrize("name", ["", ".", "..", "../x", "sub/../../x", "/etc/passwd", "link/x", "../{}x"])
def test_what_leads_elsewhere_is_refused(tmp_path: Path, name: str) -> None:
    folder = tmp_path.resolve() / "programs"
    folder.mkdir()
    (folder / "link").symlink_to("/")
    name = name.format(folder.name)  # a neighbour whose name begins as the folder's
    with pytest.raises(InputError) as caught:
        below(folder, name, "program", "programs folder")
    assert str(caught.value) == f"program: {name!r} is not below the programs folder {folder}"


@pytest.mark.parametrize("name", ["a\0b", "x" * 300, "circle"])
def test_what_can_be_no_name_is_refused(tmp_path: Path, name: str) -> None:
    folder = tmp_path.resolve()
    (folder / "circle").symlink_to("circle")
    with pytest.raises(InputError, match=r"^bag_path: "):
        below(folder, name, "bag_path", "recordings folder")
