"""The interpreter of URScript. Oracle: what the statements mean by Universal Robots' script manual."""

from __future__ import annotations

import pytest

from rtloop.backends.ur.simulator.urscript import Run, Script, ScriptError, is_complete


def run(text: str, steps: int = 100) -> list[object]:
    """What a program notes, and in which period it waits for the next one."""
    noted: list[object] = []

    def sync() -> Run:
        noted.append("|")
        yield

    functions = {"note": noted.append, "sync": sync}
    script = Script(text, functions)
    for _ in range(steps):
        if not script.step():
            break
    return noted


def test_loops_conditions_and_lists() -> None:
    text = """
def counts():
  a = [1, 2, 3]  # a comment
  i = 0
  while True:
    if i == 1:
      a[i] = 20.5
    elif i >= 3:
      break
    else:
      note(i)
    end
    i = i + 1
  end
  note(a)
  note(a[1] * 2 - a[0] / 2)
  note(not (i < 3) and True)
end
"""
    assert run(text) == [0, 2, [1, 20.5, 3], 40.5, True]


def test_threads_run_side_by_side_and_share_globals() -> None:
    text = """
def main():
  global shared = 0
  thread other():
    while shared < 2:
      note("other")
      sync()
    end
    note("done")
  end
  t = run other()
  note("main")
  sync()
  shared = 2
  join t
  note("end")
end
"""
    found = [each for each in run(text) if each != "|"]
    assert found == ["main", "other", "done", "end"]


def test_functions_return_and_have_variables_of_their_own() -> None:
    text = """
def main():
  def double(x):
    y = 2 * x
    return y
  end
  y = 1
  note(double(21) + y)
  note(double(double(1)))
end
"""
    assert run(text) == [43, 4]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("def a():\n  b()\nend\n", "line 2: name 'b' is not defined"),
        ("def a():\n  note(c)\nend\n", "line 2: name 'c' is not defined"),
        ("def a():\n  x = (1\nend\n", "line [23]: syntax error"),
        ("def a():\n  while True:\n    x = 1\n  end\nend\n", "a loop does not end"),
        ("def a():\n  x = [1][5]\nend\n", "line 2: list index out of range"),
        ("def a():\n  import os\nend\n", "line 2: this interpreter does not support Import"),
        ("def a():\n  x = note.__class__\nend\n", "line 2: this interpreter does not support Attribute"),
        ("def a():\n  x = [y for y in 1]\nend\n", "line 2: this interpreter does not support ListComp"),
        ("def a():\nend\nend\n", "line 3: end without a block"),
        ("def a():\n", "the end of a block is missing"),
        ("def a():\n  def b():\n    b()\n  end\n  b()\nend\n", "nested too deeply"),
    ],
)
def test_errors_name_the_line(text: str, found: str) -> None:
    with pytest.raises(ScriptError, match=found):
        run(text)


def test_a_program_is_complete_with_its_last_end() -> None:
    text = 'def a():\n  if True:\n    textmsg("def # end")\n  end\n'
    assert not is_complete(text)
    assert is_complete(text + "end\n")
    assert is_complete("set_digital_out(0, True)\n")
