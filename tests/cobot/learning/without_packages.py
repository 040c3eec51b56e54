"""Lets LeRobot's base classes be imported without the packages that bring gigabytes. Each of these is
replaced by an empty module whose names are empty classes; nothing that runs in the tests uses them.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import Any

NAMES = frozenset(
    {
        "accelerate",
        "av",
        "cv2",
        "datasets",
        "diffusers",
        "einops",
        "gymnasium",
        "imageio",
        "jsonlines",
        "pandas",
        "PIL",
        "pyarrow",
        "rerun",
        "safetensors",
        "termcolor",
        "torch",
        "torchvision",
        "wandb",
    }
)


class _Empty(type):
    """A class that has every name, and that can be called and decorate."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Empty(name, (), {})

    def __call__(cls, *arguments: Any, **options: Any) -> Any:
        return cls


class _Module(ModuleType):
    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Empty(name, (), {})


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname.partition(".")[0] not in NAMES:
            return None
        return importlib.machinery.ModuleSpec(fullname, self, is_package=True)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        return _Module(spec.name)

    def exec_module(self, module: ModuleType) -> None: ...


def leave_out() -> None:
    """From now on; packages that are installed are still used."""
    sys.meta_path.append(_Finder())
