"""The files for the controller. Oracles: the XML reader of the standard library, and the simulator, which is
answered by what the files say."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from lockstep_rsi import rsi_settings

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.robot.description import RobotDescription
from rtloop.backends.rsi.files import files_for
from rtloop.backends.rsi.options import RsiOptions
from rtloop.backends.rsi.telegrams import SenAnswer, decode_sen, layout_of
from rtloop.contract.__main__ import main

OPTIONS: dict[str, Any] = {
    "listen": "192.168.1.10",
    "port": 49152,
    "inputs": {"part": 17},
    "outputs": {"open": 7, "close": 8},
    "max_correction": [10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0],
    "timeout_packets": 25,
}
ETHERNET = "SensorInterface/cobot_rsi_ethernet.xml"


@pytest.fixture
def files(settings: Settings, robot: RobotDescription) -> dict[str, str]:
    return files_for(rsi_settings(settings, **OPTIONS), robot.limits)


def test_all_files_can_be_read(files: dict[str, str]) -> None:
    assert set(files) == {
        ETHERNET,
        "SensorInterface/cobot_rsi.rsix",
        "SensorInterface/cobot_rsi.rsi.xml",
        "SensorInterface/cobot_rsi.rsi",
        "Program/cobot_rsi.src",
        "Program/cobot_rsi_4_0.src",
    }
    for place, text in files.items():
        if not place.endswith(".src"):
            ET.fromstring(text)


def test_the_telegrams_are_those_of_the_backend(
    files: dict[str, str], settings: Settings, robot: RobotDescription
) -> None:
    """An answer is made of the RECEIVE elements alone, and the simulated controller reads it."""
    root = ET.fromstring(files[ETHERNET])
    assert [root.findtext(f"CONFIG/{tag}") for tag in ("IP_NUMBER", "PORT", "SENTYPE")] == [
        "192.168.1.10",
        "49152",
        "cobot",
    ]
    elements = root.findall("RECEIVE/ELEMENTS/ELEMENT")
    assert [element.get("INDX") for element in elements] == [str(n) for n in range(1, len(elements) + 1)]
    answer = ET.Element("Sen", Type="cobot")
    for number, element in enumerate(elements):
        tag, attribute = element.attrib["TAG"].split(".")
        found = answer.find(tag)
        bits = element.attrib["TYPE"] == "BOOL"
        (found if found is not None else ET.SubElement(answer, tag)).set(
            attribute, "1" if bits else str(number)
        )
    ET.SubElement(answer, "IPOC").text = "1"
    layout = layout_of(RsiOptions(**OPTIONS), robot.limits)
    micro = tuple(1_000_000 * number for number in range(7))
    assert decode_sen(ET.tostring(answer), layout) == SenAnswer(1, micro, (True, True))


@pytest.mark.parametrize(("correction", "holds"), [("absolute", "1"), ("relative", "0")])
def test_the_mode_is_in_the_program_and_in_the_configuration(
    settings: Settings, robot: RobotDescription, correction: str, holds: str
) -> None:
    files = files_for(rsi_settings(settings, 12, **OPTIONS, correction=correction), robot.limits)
    program = files["Program/cobot_rsi.src"]
    assert f"RSI_ON(#{correction.upper()}, #IPO)" in program
    assert f"$SEN_PINT[1] = {1 if correction == 'absolute' else 2}" in program
    assert 'RSI_CREATE("cobot_rsi.rsi"' in files["Program/cobot_rsi_4_0.src"]
    axes = [e for e in ET.fromstring(files[ETHERNET]).iter("ELEMENT") if e.attrib["TAG"].startswith("AK.")]
    assert {element.attrib["HOLDON"] for element in axes} == {holds}


@pytest.mark.parametrize(
    ("place", "object_tag", "identity", "kind", "first"),
    [
        ("SensorInterface/cobot_rsi.rsi.xml", "RSIObject", "ObjID", "ObjType", 1),
        ("SensorInterface/cobot_rsi.rsix", "{RsiDriver}RsiObject", "ObjId", "ObjType", 0),
    ],
)
def test_each_channel_is_connected_to_what_its_tag_says(
    files: dict[str, str], place: str, object_tag: str, identity: str, kind: str, first: int
) -> None:
    root = ET.fromstring(files[place])
    objects = {found.attrib[identity]: found for found in root.iter(object_tag)}
    sources = [
        (each.attrib["OutObjID" if first else "OutObjId"], int(each.attrib["OutIdx"]) - first)
        for each in objects["ETHERNET1"].iter()
        if each.tag.endswith("Input")
    ]
    sent = [e for e in ET.fromstring(files[ETHERNET]).iter("ELEMENT") if "HOLDON" not in e.attrib]
    tags = [e.attrib["TAG"] for e in sent if e.attrib["INDX"] != "INTERNAL"]
    by_tag = dict(zip(tags, sources, strict=True))
    assert by_tag["AxisCorrMon.A6"] == ("AXISCORRMON1", 5)
    assert by_tag["AxisCorrMon.E1"] == ("AXISCORRMON1", 6)
    for tag, number, type_name in (
        ("State.T1", 993, "digout"),
        ("State.NoStop", 1013, "digout"),
        ("In.i1", 17, "digin"),
        ("Out.o2", 8, "digout"),
    ):
        found = objects[by_tag[tag][0]]
        assert found.attrib[kind].lower() == type_name
        assert parameters(found)["Index"] == str(number)
    limits = parameters(objects["AXISCORR1"]) | parameters(objects["AXISCORREXT1"])
    assert (limits["LowerLimA3"], limits["UpperLimA6"], limits["UpperLimE1"]) == ("-30", "60", "70")
    assert parameters(objects["AXISCORRMON1"])["MaxA1"] == "11"
    assert parameters(objects["ETHERNET1"])["Timeout"] == "25"


def parameters(found: ET.Element) -> dict[str, str]:
    return {
        each.attrib["Name"]: each.attrib["ParamValue"]
        for each in found.iter()
        if each.tag.endswith("Parameter")
    }


def test_a_robot_without_external_axes_has_no_object_for_them(
    settings: Settings, robot: RobotDescription
) -> None:
    """RSI rejects an object of an axis that the robot does not have."""
    limits = robot.limits
    cut = {name: getattr(limits, name)[:6] for name in limits.QUANTITIES}
    six = replace(limits, names=limits.names[:6], slides=(), **cut)
    options = {**OPTIONS, "max_correction": 5.0}
    files = files_for(rsi_settings(settings, **options), six)
    assert not any("AXISCORREXT" in text or "EIPos" in text or ".E1" in text for text in files.values())


def test_the_address_of_this_computer_must_be_known(settings: Settings, robot: RobotDescription) -> None:
    with pytest.raises(ConfigError, match=r"robot.backend.listen is 0.0.0.0: set it to the address that"):
        files_for(rsi_settings(settings), robot.limits)


def test_the_command_writes_them_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "rsi.yaml"
    config.write_text(
        yaml.safe_dump(
            {"robot": {"backend": {"type": "rsi", "listen": "10.0.0.1"}}, "rt": {"period_s": 0.004}}
        )
    )
    folder = tmp_path / "files"
    assert main(["files", "rsi", str(folder), "--config", str(config)]) == 0
    assert str(folder / ETHERNET) in capsys.readouterr().out
    assert (folder / "Program/cobot_rsi.src").is_file()
    assert main(["files", "rsi", str(folder), "--config", str(config)]) == 1
    assert "already exists" in capsys.readouterr().err
    assert main(["files", "mujoco", str(folder)]) == 1
    assert "mujoco does not provide files for a robot controller" in capsys.readouterr().err
    assert main(["files", "rsi", str(tmp_path / "other")]) == 1
    assert "robot.backend is mujoco, not rsi" in capsys.readouterr().err
