"""Record the golden traces anew: `python tests/rtloop/golden/record.py`, some minutes.

Only where a change of what the arm does is argued for, by `--only NAME ...`; what changes is then named in
changes.md. With `--inputs` the motions that the scenarios follow are planned anew, too.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "support"))

import numpy as np
from golden import ensemble, inputs, stage
from golden.scenarios import SCENARIOS

from cobot.config import load_settings
from cobot.robot.description import load_robot

MEMBERS = (
    ("", 0.0),
    ("Nehalem", 0.0),
    ("Haswell", 0.0),
    ("", 1e-13),
    ("", -3e-14),
    ("", 1e-12),
    ("", -7e-13),
)
"""BLAS kernel, and how far from their place the joints start, rad; the first is what is recorded."""
ASIDE = np.array([1.0, -0.7, 0.3, -0.9, 0.8, -0.4, 0.6])


def record(path: Path, shift_rad: float, names: list[str]) -> None:
    """Play these scenarios once."""
    settings = load_settings()
    robot = load_robot(settings)
    given, traces = stage.load_inputs(), {}
    begun_s = time.perf_counter()
    for name in names:
        seen = stage.play(settings, robot, given, name, shift_rad * ASIDE)
        traces |= {f"{name}/{what}": values for what, values in seen.items()}
        if not shift_rad:
            print(f"{int(seen['cycles']):5d} {name}: {' | '.join(str(seen['words']).splitlines())}")
    np.savez_compressed(path, **traces)
    print(f"{len(names)} scenarios in {time.perf_counter() - begun_s:.1f} s")


def play_member(folder: str, number: int, names: list[str]) -> ensemble.Traces:
    """Have a process of its own record one run of these scenarios; what it has recorded."""
    kernel, shift_rad = MEMBERS[number]
    path = Path(folder) / f"{number}.npz"
    surroundings = os.environ | ({"OPENBLAS_CORETYPE": kernel} if kernel else {})
    command = [sys.executable, __file__, "--once", str(path), f"--shift={shift_rad}", "--only", *names]
    subprocess.run(command, env=surroundings | {"PYTHONHASHSEED": str(number)}, check=True)
    with np.load(path) as file:
        return {key: file[key] for key in file.files}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", action="store_true")
    parser.add_argument("--once", type=Path, help="only play everything once, and write that here")
    parser.add_argument("--only", nargs="+", metavar="NAME", default=list(SCENARIOS), choices=list(SCENARIOS))
    parser.add_argument("--shift", type=float, default=0.0, metavar="RAD")
    wanted = parser.parse_args()
    if wanted.inputs:
        np.savez_compressed(stage.INPUTS, **inputs.make(load_robot(load_settings())))
    if wanted.once:
        record(wanted.once, wanted.shift, wanted.only)
        return
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
        runs = list(pool.map(lambda number: play_member(folder, number, wanted.only), range(len(MEMBERS))))
    with np.load(stage.TRACES) as file:
        traces = {key: file[key] for key in file.files} | ensemble.with_spread(runs)
    np.savez_compressed(stage.TRACES, **traces)
    print(f"{stage.TRACES}: {stage.TRACES.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
