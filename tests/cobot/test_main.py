"""The program itself, from its first import on."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from cobot.__main__ import BLAS_THREADS

TELLS_WHAT_NUMPY_FINDS = """
import os, sys

class Look:
    def find_spec(self, name, *_):
        if name == "numpy":
            print("numpy finds", os.environ["OPENBLAS_NUM_THREADS"])

sys.meta_path.insert(0, Look())
sys.argv = ["cobot", "new-robot", "--help"]
from cobot.__main__ import main
assert "numpy" not in sys.modules
try:
    main()
finally:
    import numpy
"""
INTERRUPTED_AT_ITS_IMPORT = """
import runpy, sys

class Interruption:
    def find_spec(self, name, *_):
        if name == "cobot.config":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interruption())
runpy.run_module("cobot", run_name="__main__")
"""


def test_who_interrupts_it_while_it_starts_is_not_shown_where() -> None:
    command = [sys.executable, "-c", INTERRUPTED_AT_ITS_IMPORT]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "cobot: interrupted\n")


@pytest.mark.parametrize(("given", "taken"), [(None, "1"), ("3", "3")])
def test_numpy_of_all_its_processes_computes_in_one_thread_unless_told_otherwise(
    given: str | None, taken: str
) -> None:
    """Oracle: the environment, as numpy finds it when it is imported and as processes inherit it."""
    surroundings = os.environ | {BLAS_THREADS: given or ""}
    if given is None:
        del surroundings[BLAS_THREADS]
    command = [sys.executable, "-c", TELLS_WHAT_NUMPY_FINDS]
    done = subprocess.run(command, env=surroundings, capture_output=True, text=True, check=True)
    assert f"numpy finds {taken}" in done.stdout.splitlines()
