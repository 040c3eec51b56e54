"""Counts the elements of an MJCF file before MuJoCo creates them. The count includes elements that other
elements create.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree.ElementTree import Element

from cobot.errors import ConfigError
from cobot.xml_file import is_printable, parse, shown, where

MAX_ELEMENTS = 5_000
"""Maximum number of elements in a file, including those that <replicate> and <composite> make. The time to
read a file grows with the square of this number.
"""
MAX_JOINTS = 500
"""Maximum number of joints in a file. The time to remove one joint grows with the number of the other
joints.
"""
MAX_CELLS = 4_000_000
"""Maximum number of cells in a height field: 2000 by 2000."""
MAX_INCLUDED = 100
"""Maximum number of files that a file includes, or attaches as models."""
MAX_SHOWN = 10**12
"""The largest number that a message writes out."""
MULTIPLYING = ("replicate", "composite")
SOFT = ("flexcomp", "flex")
JOINTS = ("joint", "freejoint")
ALLOCATING = re.compile("nkey|nuser")
"""Attributes of <size> that determine how much memory MuJoCo allocates."""
TEXTS = re.compile(
    r"name|.*(class|joint|body|geom|site|file|mesh)\d?|material|texture|target|prefix|model|tendon"
)
"""Attributes that are names, which may therefore be the text `inf`."""


def check_mjcf(file: Path, root: Element) -> None:
    """Reject files with far too many elements, a height field that is far too large, soft bodies, numbers
    that are not finite, or invalid names.

    Raises:
        ConfigError: the file contains one of them; the message names the line, the element, the number and
            the limit.
    """
    _Counter(file).add(file, root, 1)


class _Counter:
    """The elements in a file and in the files that it includes or attaches."""

    def __init__(self, file: Path) -> None:
        self._folder = file.parent
        self._included = 0
        self._count = self._joints = 0

    def add(self, file: Path, root: Element, times: int) -> None:
        """Count an element that is created `times` times, and everything in it."""
        models = {model.get("name"): model.get("file") for model in root.iter("model")}
        pending = [(root, times)]
        while pending:
            element, times = pending.pop()
            for attribute in ("name", "prefix"):
                _check_name(file, element, element.get(attribute))
            _check_finite(file, element)
            if element.tag == "hfield":
                cells = _product(file, element, "nrow") * _product(file, element, "ncol")
                _require(file, element, "cells", cells, MAX_CELLS)
            if element.tag == "size":
                for attribute in filter(ALLOCATING.match, element.keys()):
                    count = _product(file, element, attribute)
                    _require(file, element, f"entries by {attribute}", count, MAX_ELEMENTS)
            if element.tag in SOFT:
                raise ConfigError(
                    f"{where(file, element)}: <{element.tag}> makes a soft body; cobot checks collisions of "
                    "rigid bodies only: remove it, or describe it with geoms"
                )
            if element.tag in MULTIPLYING:
                times *= _product(file, element, "count")
            self._count += times
            _require(file, element, "elements in the file", self._count, MAX_ELEMENTS)
            self._joints += times * (element.tag in JOINTS)
            _require(file, element, "joints in the file", self._joints, MAX_JOINTS)
            pending += [(child, times) for child in element]
            if element.tag == "include" and (name := element.get("file")):
                self._include(file, element, name, times)
            if element.tag == "attach" and (name := models.get(element.get("model"))):
                self._include(file, element, name, times)

    def _include(self, file: Path, element: Element, name: str, times: int) -> None:
        self._included += 1
        _require(file, element, "included files", self._included, MAX_INCLUDED)
        if (path := self._folder / name).is_file():
            self.add(path, parse(path)[0], times)


def _check_name(file: Path, element: Element, name: str | None) -> None:
    """Check a name. MuJoCo accepts any name, but cobot uses it as a key, in topics and in messages."""
    if name and not is_printable(name):
        raise ConfigError(
            f"{where(file, element)}: <{element.tag}> has the name {shown(name)}; give it a printable name "
            "of 1 to 200 characters without spaces at its ends"
        )


def _check_finite(file: Path, element: Element) -> None:
    """Reject a number that is not finite. MuJoCo only warns about NaN, and saves it as 0."""
    for attribute, text in element.items():
        if TEXTS.fullmatch(attribute):
            continue
        for word in text.split():
            if word.lstrip("+-").lower() in ("nan", "inf", "infinity"):
                raise ConfigError(
                    f"{where(file, element)}: {attribute} of <{element.tag}> contains {word!r}; it must be a "
                    "finite number"
                )


def _product(file: Path, element: Element, attribute: str) -> int:
    """The product of the whole numbers in an attribute. At most three numbers are used. 1 if the attribute is
    missing.
    """
    text = element.get(attribute, "1")
    try:
        return math.prod(max(1, int(float(word))) for word in text.split()[:3])
    except (ValueError, OverflowError) as exc:
        raise ConfigError(
            f"{where(file, element)}: {attribute} of <{element.tag}> is {shown(text)}; it must be a whole "
            "number"
        ) from exc


def _require(file: Path, element: Element, what: str, count: int, limit: int) -> None:
    if count > limit:
        made = f"{count}" if count <= MAX_SHOWN else f"more than {MAX_SHOWN}"
        raise ConfigError(
            f"{where(file, element)}: <{element.tag}> makes {made} {what}; at most {limit} are allowed"
        )
