"""Functions and documents of studies, for tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cobot.studies import Study, study_of

PRODUCT = """
import os, time

def product(a, b):
    return {"value": a * b, "even": a % 2 == 0, "name": f"{a:g} x {b:g}"}

def draws(a, seed):
    import random
    return random.Random(seed).random() + a

def fails_at_three(a, b):
    if a == 3:
        raise ValueError("three is not allowed")
    return a + b

def dies_at_three(a, b):
    if a == 3 and b == 1:
        os.kill(os.getpid(), 9)
    return a + b

def mixed(a, b):
    return a if a < 2 else str(a)

def strange(a, b):
    import sys
    if b == 1:
        sys.exit(3)
    if b == 2:
        raise KeyboardInterrupt
    return {"": 1} if a == 1 else {"a": 1} if a == 2 else 10**400 if a == 3 else None if a == 4 else 7

def bowl(a, b):
    import math
    return (a - 1) ** 2 + (b - 2) ** 2 + 0.1 * math.sin(5 * a)

def slow(a, b):
    time.sleep(0.02)
    return a * b
"""


def function_study(folder: Path, function: str = "product", **more: Any) -> Study:
    """A study of a function of `PRODUCT` on a grid of 5 x 4 points."""
    (folder / "functions.py").write_text(PRODUCT, encoding="utf-8")
    space = {"a": {"low": 0, "high": 4, "count": 5}, "b": {"values": [0, 1, 2, 3]}}
    document = {
        "question": "How large is it?",
        "kind": "python",
        "function": f"functions.py:{function}",
        "space": space,
    }
    return study_of(document | more, folder, "study.yaml")


def reach_study(**more: Any) -> Study:
    """A small study of the reach of the shipped arm."""
    document = {
        "question": "What does it reach?",
        "kind": "reach",
        "space": {"box": {"low": [-0.8, -0.4, 0.1], "high": [0.8, 0.4, 1.1]}, "spacing_m": 0.4},
    }
    return study_of(document | more)
