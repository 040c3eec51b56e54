"""The package of ROS interfaces.

Oracle: rosbags' parser of message definitions and its CDR; ElementTree.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from app.aubo.interfaces import PACKAGE, SMALL, interface_definitions, main, package_files
from app.aubo.registry import REGISTRY

DEFINITIONS = interface_definitions()
SEPARATOR = re.compile(r"^---$", re.MULTILINE)


def test_the_command_writes_the_package_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for options, files in (([], package_files()), (["--small"], package_files(SMALL))):
        monkeypatch.setattr("sys.argv", ["interfaces", str(tmp_path), *options])
        main()
        folder = tmp_path / PACKAGE
        written = [path for path in folder.rglob("*") if path.is_file()]
        assert {str(path.relative_to(folder)): path.read_text(encoding="utf-8") for path in written} == files


@pytest.mark.parametrize("path", ["notes.txt", "srv/Mine.srv", "package.xml"])
def test_a_folder_with_files_of_the_user_is_refused_and_left_as_it_is(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["interfaces", str(tmp_path), "--small"])
    assert main() == 0
    folder = tmp_path / PACKAGE
    (folder / path).write_text("mine")
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    assert main() == 2
    said = capsys.readouterr().err
    assert said.startswith(f"{folder}: has other files, which this command has not written: ")
    assert path in said
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before


def test_a_package_that_another_program_has_written_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / PACKAGE / "src").mkdir(parents=True)
    (tmp_path / PACKAGE / "src" / "node.cpp").write_text("int main() {}")
    monkeypatch.setattr("sys.argv", ["interfaces", str(tmp_path)])
    assert main() == 2
    assert "src/node.cpp; move them, or choose another folder" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / PACKAGE).rglob("*")] == ["src", "node.cpp"]


def test_each_service_has_a_text_whose_fields_are_its_own() -> None:
    for found in REGISTRY.values():
        request, answer = SEPARATOR.split(DEFINITIONS[f"{PACKAGE}/srv/{found.type_name}"])
        asked = [(field.ros_type, field.name) for field in found.parameters]
        assert _fields(request) == asked
        assert _fields(answer) == [
            ("int32", "code"),
            ("string", "message"),
            (found.result.ros_type, "result"),
        ]


@pytest.mark.parametrize("name", list(DEFINITIONS))
def test_each_text_is_one_that_ros_understands(name: str) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    for index, part in enumerate(SEPARATOR.split(DEFINITIONS[name])):
        store.register(get_types_from_msg(part + "\n", f"{PACKAGE}/msg/Part{index}"))


def test_an_answer_goes_through_cdr() -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    _, answer = SEPARATOR.split(DEFINITIONS[f"{PACKAGE}/srv/InverseKinematics"])
    name = f"{PACKAGE}/msg/Answer"
    store.register(get_types_from_msg(answer, name))
    message = store.types[name](code=0, message="", result="[[0.5],0]")
    assert store.deserialize_cdr(store.serialize_cdr(message, name), name) == message


def test_what_the_script_of_the_manual_uses_has_the_fields_that_it_uses() -> None:
    expected = {
        "GetDof": ([], "int32"),
        "GetExecId": ([], "int32"),
        "GetJointPositions": ([], "float64[]"),
        "InverseKinematics": ([("float64[]", "qnear"), ("float64[]", "pose")], "string"),
        "IsSteady": ([], "bool"),
        "MoveJoint": (
            [("float64[]", "q"), *(("float64", name) for name in ("a", "v", "blend_radius", "duration"))],
            "int32",
        ),
    }
    for name, (fields, result) in expected.items():
        request, answer = SEPARATOR.split(DEFINITIONS[f"{PACKAGE}/srv/{name}"])
        assert _fields(request) == fields
        assert _fields(answer)[2] == (result, "result")


def test_the_build_lists_every_interface_and_what_it_needs() -> None:
    files = package_files()
    listed = re.findall(r'^  "(.+)"$', files["CMakeLists.txt"], re.MULTILINE)
    assert listed == [path for path in files if path.endswith((".srv", ".action"))]
    package = ET.fromstring(files["package.xml"])
    assert package.findtext("name") == PACKAGE
    assert package.findtext("member_of_group") == "rosidl_interface_packages"
    assert package.findtext("buildtool_depend") == "ament_cmake"
    needed = {package.findtext("build_depend"), package.findtext("exec_depend")}
    assert needed == {"rosidl_default_generators", "rosidl_default_runtime"}


def _fields(text: str) -> list[tuple[str, ...]]:
    return [tuple(line.split()) for line in text.splitlines() if line and not line.startswith("#")]
