"""Reading timed points from CSV.

Oracles: the standard library's csv writer (what was written is read back, bit for bit), numpy.loadtxt,
and the row, column and text that the test has put there.
"""

from __future__ import annotations

import contextlib
import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.services.motion import csv_points
from app.services.motion.csv_columns import SHOWN_CHARACTERS
from app.services.motion.csv_points import read_points
from cobot.errors import InputError
from cobot.planners import WaypointRequest, plan_waypoints
from cobot.robot.description import RobotDescription
from cobot.types import Waypoint

DOF = 7
JOINTS = [f"joint{n}" for n in range(1, DOF + 1)]
HEADER = ",".join([*JOINTS, "t"])
ROW = "0,0.5,0,-1.0,0,1.0,0,3.0"
QUOTED = '"0\n",0,0,0,0,0,0,1'
EXAMPLE = Path(__file__).parents[4] / "examples" / "trajectory.csv"

numbers = st.floats(allow_nan=False, allow_infinity=False)


def read(text: str | bytes, separator: str | None = ",", joints: Sequence[str] = JOINTS) -> list[Waypoint]:
    return read_points(io.BytesIO(text if isinstance(text, bytes) else text.encode()), separator, joints)


def refusal(text: str | bytes, separator: str | None = ",") -> str:
    with pytest.raises(InputError) as caught:
        read(text, separator)
    return str(caught.value)


@st.composite
def tables(draw: st.DrawFn) -> tuple[list[str], list[list[float]]]:
    """A header in some order and spelling, and rows of any floats."""
    gap = draw(st.sampled_from(["", "_"]))
    kinds = ["joint", *draw(st.lists(st.sampled_from(["velocity", "acceleration"]), unique=True))]
    names = [f"{kind}{gap}{n}" for kind in kinds for n in range(1, 4)]
    names = draw(st.permutations([*names, draw(st.sampled_from(["t", "time", "time_from_start"]))]))
    spelling = draw(st.sampled_from([str.lower, str.upper, str.title, lambda name: f" {name} "]))
    width = len(names)
    rows = draw(st.lists(st.lists(numbers, min_size=width, max_size=width), min_size=1, max_size=5))
    return [spelling(name) for name in names], rows


def plain(name: str) -> str:
    return name.strip().lower().replace("_", "")


@given(
    tables(),
    st.sampled_from(",;|\t "),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]),
    st.sampled_from(["utf-8", "utf-8-sig"]),
    st.booleans(),
)
def test_what_a_csv_writer_writes_is_read_back_exactly(
    table: tuple[list[str], list[list[float]]],
    separator: str,
    line_end: str,
    quoting: int,
    encoding: str,
    comma: bool,
) -> None:
    names, rows = table
    file = io.StringIO(newline="")
    writer = csv.writer(file, delimiter=separator, lineterminator=line_end, quoting=quoting)
    writer.writerow(names)
    decimal = "," if comma and separator == ";" else "."
    writer.writerows([repr(value).replace(".", decimal) for value in row] for row in rows)
    points = read(file.getvalue().encode(encoding) + line_end.encode(), separator, JOINTS[:3])
    assert len(points) == len(rows)
    for number, (point, row) in enumerate(zip(points, rows, strict=True), start=2):
        written = {plain(name): value for name, value in zip(names, row, strict=True)}
        time = next(written[name] for name in ("t", "time", "timefromstart") if name in written)
        assert point.time_from_start_s == time
        assert point.positions == [written[f"joint{n}"] for n in (1, 2, 3)]
        for kind, values in (("velocity", point.velocities), ("acceleration", point.accelerations)):
            expected = [written[f"{kind}{n}"] for n in (1, 2, 3)] if f"{kind}1" in written else None
            assert values == expected
        assert point.label == f"row {number}"


def test_numpy_reads_the_same_numbers() -> None:
    points = read(EXAMPLE.read_bytes())
    oracle = np.loadtxt(EXAMPLE, delimiter=",", skiprows=1)
    ours = [[*point.positions, point.time_from_start_s] for point in points]
    np.testing.assert_array_equal(ours, oracle)


def test_the_shipped_example_starts_and_ends_at_home_and_is_feasible(robot: RobotDescription) -> None:
    points = read(EXAMPLE.read_bytes())
    home = np.array(robot.positions["home"].joints)
    np.testing.assert_array_equal([points[0].positions, points[-1].positions], [home, home])
    assert points[0].time_from_start_s == 0.0
    motion = plan_waypoints(robot, WaypointRequest(home, points, 1e-6))
    assert motion.duration_s == points[-1].time_from_start_s


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (HEADER.replace("joint7", "joint8"), ["column 7", "'joint8'", "joint7", "acceleration7"]),
        (HEADER.replace("joint7", "joint\uff17"), ["column 7", "'joint\uff17'", "joint7"]),
        (HEADER.replace("joint7", "jont7"), ["column 7", "'jont7'", "did you mean 'joint7'"]),
        (HEADER.replace("joint7", "joint_1"), ["column 7", "'joint_1'", "'joint1' in column 1"]),
        (HEADER + ",TIME", ["column 9", "'TIME'", "'t' in column 8"]),
        (HEADER.replace(",t", ""), ["missing column t"]),
        (HEADER.replace("joint3,", ""), ["missing column joint3"]),
        (HEADER + ",velocity2", ["missing column velocity1, velocity3", "velocity7"]),
        (HEADER + ",", ["column 9", "''", "valid keys: joint1"]),
        ("", ["row 1 is empty"]),
    ],
)
def test_a_header_that_does_not_fit_is_named_with_the_valid_columns(header: str, words: list[str]) -> None:
    message = refusal(f"{header}\n{ROW}\n")
    assert message.startswith("row 1")
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    "text",
    [
        "abc",
        "",
        "nan",
        "inf",
        "-Infinity",
        "1e999",
        "1_0",
        "0x10",
        "1,0",
        "1 0",
        "--1",
        "\x00",
        "1\x00",
        "\u0661",
        "\uff11",
    ],
)
def test_what_is_no_finite_number_is_named_with_row_column_and_text(text: str) -> None:
    cell = f'"{text}"' if "," in text else text
    message = refusal(f"{HEADER}\n{ROW}\n0,0,0,{cell},0,0,0,4\n")
    assert "row 3, column joint4" in message
    assert repr(text) in message


def test_a_long_text_is_cut_in_the_message() -> None:
    message = refusal(f"{HEADER}\n{'x' * 1000},0,0,0,0,0,0,1\n")
    assert "x" * SHOWN_CHARACTERS + "..." in message
    assert len(message) < 150


def test_a_decimal_comma_is_for_semicolons_only() -> None:
    row = ";".join(["0,25"] * 7 + ["1,5"])
    assert read(f"{HEADER.replace(',', ';')}\n{row}\n", ";")[0].positions == [0.25] * 7
    assert "'0,25'" in refusal(f"{HEADER.replace(',', '|')}\n{row.replace(';', '|')}\n", "|")
    assert "'1.000,5'" in refusal(f"{HEADER.replace(',', ';')}\n{row.replace('1,5', '1.000,5')}\n", ";")


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (["0;0,5;1", "0;0;2.000"], ["'2.000' in row 3, column t", "'0,5' in row 2, column joint2"]),
        (["0;0.5;1", "0;0;2,000"], ["'0.5' in row 2, column joint2", "'2,000' in row 3, column t"]),
        (["0;1.234,5;1"], ["'1.234,5' in row 2, column joint2"]),
    ],
)
def test_a_file_with_points_and_decimal_commas_is_refused_with_a_cell_of_each(
    rows: list[str], words: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        read("\n".join(["joint1;joint2;t", *rows]), None, JOINTS[:2])
    for word in [*words, "write numbers without thousands separators"]:
        assert word in str(caught.value)


def test_a_file_with_semicolons_may_have_points_throughout() -> None:
    (point,) = read("joint1;joint2;t\n0.5;-1.25;2.000\n", None, JOINTS[:2])
    assert (point.positions, point.time_from_start_s) == ([0.5, -1.25], 2.0)


def test_the_robots_own_names_head_the_columns_in_any_order_and_case() -> None:
    own = ["shoulder_pan", "joint_0", "Elbow"]
    header = "elbow,SHOULDER_PAN,time,joint_0,velocity_joint_0,velocity_elbow,velocity_shoulder_pan"
    (point,) = read(f"{header}\n3,1,0,2,5,6,4\n", None, own)
    assert (point.positions, point.velocities) == ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0])


def test_numbers_name_the_joints_of_a_robot_whose_own_names_are_others() -> None:
    (point,) = read("joint_1,joint_2,t\n0.1,0.2,0\n", None, ["shoulder", "elbow"])
    assert point.positions == [0.1, 0.2]


def test_a_number_never_stands_for_another_joint_than_the_one_of_that_name() -> None:
    with pytest.raises(InputError, match=r"column 2: unknown key 'joint_2'.*valid keys: joint_0, joint_1, t"):
        read("joint_1,joint_2,t\n0,0,0\n", None, ["joint_0", "joint_1"])


@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("written", [";", "\t", ",", ", ", " ; ", " ", "   "])
def test_the_separator_is_found_in_the_header(written: str, line_end: str) -> None:
    rows = [HEADER, ROW, ROW.replace("3.0", "4.0")]
    text = line_end.join(row.replace(",", written) for row in rows)
    points = read(text, None)
    assert [point.positions for point in points] == [[0, 0.5, 0, -1.0, 0, 1.0, 0]] * 2
    assert [point.time_from_start_s for point in points] == [3.0, 4.0]
    assert [point.label for point in points] == ["row 2", "row 3"]


def test_white_space_may_be_of_any_length_and_on_either_side() -> None:
    text = f"\ufeff  {HEADER.replace(',', '   ')} \n\n"
    assert "the file has a header, but no rows" in refusal(text, None)
    words = ROW.split(",")
    points = read(f"{HEADER.replace(',', '  ')}\n   {' '.join(words)}\n{'   '.join(words)}  \n", None)
    assert len(points) == 2
    assert "row 3, column joint2: must be a finite number, got 'x'" in refusal(
        f"{HEADER.replace(',', ' ')}\n{' '.join(words)}\n0 x 0 0 0 0 0 4\n", None
    )
    assert "row 1: not CSV: more than 65536 characters" in refusal("x" * 200_000, None)
    assert "not UTF-8 text (byte 0xff)" in refusal(HEADER.replace(",", " ").encode() + b"\n\xff", None)


def test_decimal_commas_with_semicolons_are_found_too() -> None:
    row = ";".join(["0,25"] * 7 + ["1,5"])
    assert read(f"{HEADER.replace(',', ';')}\n{row}\n", None)[0].positions == [0.25] * 7


@pytest.mark.parametrize("separator", [",", "\t", " "])
def test_other_decimal_commas_are_refused_in_so_many_words(separator: str) -> None:
    row = separator.join(["0,25"] * 7 + ["1,5"])
    message = refusal(f"{HEADER.replace(',', separator)}\n{row}\n", None)
    assert message.startswith("row 2")
    assert "decimal commas are allowed only if semicolons separate the columns: write 0.5" in message


def test_the_first_point_is_looked_at_before_the_others_are_read() -> None:
    class Elsewhere(Exception):
        pass

    def check(point: Waypoint) -> None:
        assert point.label == "row 2"
        raise Elsewhere

    with pytest.raises(Elsewhere):
        read_points(io.BytesIO(f"{HEADER}\n{ROW}\nnonsense\n".encode()), None, JOINTS, check)


@given(st.binary(max_size=400))
def test_no_bytes_do_anything_but_be_refused_when_the_separator_is_looked_for(content: bytes) -> None:
    refusal(content, None)
    refusal(HEADER.replace(",", " ").encode() + b"\n\xff" + content, None)


@pytest.mark.parametrize("cells", [7, 9])
def test_a_ragged_row_is_named_with_both_counts(cells: int) -> None:
    message = refusal(f"{HEADER}\n{ROW}\n{','.join(['0'] * cells)}\n")
    assert message == f"row 3: has {cells} columns, but the header has 8"


@pytest.mark.parametrize("blank", ["", "   ", ",,,,,,,", '""'])
def test_blank_lines_are_allowed_at_the_end_and_nowhere_else(blank: str) -> None:
    assert len(read(f"{HEADER}\n{ROW}\n{blank}\n{blank}\n")) == 1
    assert refusal(f"{HEADER}\n{ROW}\n{blank}\n{ROW}\n") == "row 3 is blank, but row 4 is not"


def test_rows_are_counted_in_lines_of_the_file() -> None:
    """A quoted cell may hold a line end; an editor's line number is what helps."""
    points = read(f'{HEADER}\n"0\n",0,0,0,0,0,0,1\n{ROW}\n')
    assert [point.label for point in points] == ["row 2", "row 4"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (bytes(range(256)) * 100, "not UTF-8 text (byte 0x80)"),
        (HEADER.encode("utf-16"), "not UTF-8 text (byte 0xff)"),
        (f"{HEADER}\n".encode() + b"0,\xe9", "row 2 or soon after: not UTF-8 text (byte 0xe9)"),
        (f'{HEADER}\n"0'.encode(), "row 2: not CSV: unexpected end of data"),
        (b"x" * 200_000, "row 1: not CSV: more than 65536 characters in a line"),
        (b"," * 200_000, "row 1: not CSV: more than 65536 characters in a line"),
        (f"{HEADER}\n{ROW}\n".encode() + b"0," * 40_000, "row 3: not CSV: more than 65536 characters"),
        (
            f'{HEADER}\n"{"9" * 40_000}\n{"9" * 40_000}\n{"9" * 60_000}"'.encode(),
            "row 2: not CSV: field larger",
        ),
        (b"", "row 1 is empty"),
        (HEADER.encode(), "the file has a header, but no rows"),
    ],
)
def test_what_is_no_csv_is_refused(content: bytes, words: str) -> None:
    assert words in refusal(content)


@given(st.binary(max_size=400), st.sampled_from(",;|\t "))
def test_no_bytes_do_anything_but_be_refused(content: bytes, separator: str) -> None:
    """No random bytes make a row of eight numbers; every other exception would be a bug."""
    refusal(content, separator)
    refusal(HEADER.replace(",", separator).encode() + b"\n\xff" + content, separator)


@pytest.mark.parametrize(
    "separator", ["", ",,", "a", "é", "1", ".", "-", "+", '"', "'", "\n", "\x00", "\xa0"]
)
def test_what_cannot_separate_numbers_is_no_separator(separator: str) -> None:
    assert f"separator: {separator!r} cannot separate" in refusal(f"{HEADER}\n{ROW}\n", separator)


def test_a_row_too_many_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    assert csv_points.MAX_ROWS == 100_000
    monkeypatch.setattr(csv_points, "MAX_ROWS", 3)
    rows = f"{ROW}\n" * 3
    assert len(read(f"{HEADER}\n{rows}\n")) == 3
    assert refusal(f"{HEADER}\n{rows}{ROW}\n") == "row 5: there are more than 3 rows"


def test_rows_too_many_are_refused_before_one_is_taken_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_points, "MAX_ROWS", 300)
    rows = f"{ROW}\n" * 300
    for chunk in (7, 100, 10**6):
        monkeypatch.setattr(csv_points, "CHUNK_BYTES", chunk)
        for behind in ("", "\n\n", ",,,,,,,\n\n", "  "):
            assert len(read(f"{HEADER}\n{rows}{behind}")) == 300
            assert len(read(f"{HEADER}\n{rows.rstrip()}{behind and chr(10)}{behind}")) == 300
        assert len(read(f"{HEADER}\n{rows.replace(ROW, QUOTED, 1)}")) == 300
        for behind, row in ((ROW, 302), (f"\n\n{ROW}", 304), (f"{ROW}\n" * 300, 302)):
            with monkeypatch.context() as m:
                m.setattr(csv_points, "_read", None)
                assert refusal(f"{HEADER}\n{rows}{behind}") == f"row {row}: there are more than 300 rows"


@pytest.mark.parametrize("lines", ["\r" * 10, '"0\n",' * 10, "\n" * 10])
def test_lines_without_end_are_refused_whatever_they_are(lines: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """15 MB of carriage returns, which are no rows, were read for two minutes."""
    monkeypatch.setattr(csv_points, "MAX_LINES", 8)
    assert refusal(f"{HEADER}\n{lines}") == "row 9: there are more than 8 lines"
    assert refusal(f"{HEADER}\n{lines}", ";").startswith("row 1")


def test_what_is_behind_the_last_row_is_not_taken_apart_line_by_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """An upload that is nothing but line ends took five seconds to be refused."""
    looked: list[int] = []

    class Counting:
        def search(self, chunk: bytes, start: int = 0) -> re.Match[bytes] | None:
            looked.append(start)
            return re.search(rb"[0-9]", chunk[start:])

    monkeypatch.setattr(csv_points, "_DIGIT", Counting())
    assert refusal(b"\n" * 10**6) == "row 1 is empty; it must name the columns"
    assert len(looked) <= 2


def test_the_file_stays_open_for_its_owner() -> None:
    for content in (f"{HEADER}\n{ROW}\n", "nonsense"):
        file = io.BytesIO(content.encode())
        with contextlib.suppress(InputError):
            read_points(file, ",", JOINTS)
        assert not file.closed
