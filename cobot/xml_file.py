"""Reads XML files as bytes, because the declaration in the file decides the encoding. Each element stores its
line.

Namespaces are not resolved, so `xacro:property` is the name of a tag. A DOCTYPE is rejected, so there are no
entities. Numbers must be decimal and finite, and there must be as many as the format requires.
"""

from __future__ import annotations

import codecs
import re
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from cobot.errors import ConfigError

MAX_BYTES = 50_000_000
MAX_DEPTH = 500
XACRO = re.compile(r"https?://(www\.)?ros\.org/(wiki/)?xacro/?")
"""The namespace of xacro, in all its spellings."""
BOMS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
"""Byte order marks in the order in which they are tried. The mark of UTF-32 begins like that of UTF-16, so it
comes first.
"""
DECLARATION = re.compile(rb"""\s*<\?xml[^>]*?\sencoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
WIDE = ("utf-16", "utf-32", "ucs-", "utf16", "utf32")
"""Encodings that cannot be correct if the declaration could be read byte by byte."""
SLOW = ("idna", "punycode")
"""Codecs whose time grows with the square of the text's length. They are not meant for files."""
DECIMAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
MAX_NUMBER = 1e15
"""Largest number that is allowed in a file. Larger numbers are errors in the file, and their squares would
lose all digits.
"""
SHOWN = 60
"""Maximum number of characters of a wrong value in a message."""


class Element(ElementTree.Element):
    """An element that also stores its line number in the file."""

    line: int = 0


def parse(file: Path) -> tuple[Element, int]:
    """The root element, and the first line on which the file uses xacro (0 if it does not use it).

    Raises:
        ConfigError: the file is missing or is not XML; the message names the line.
    """
    if not file.is_file():
        raise ConfigError(f"{file}: {'is not a file' if file.exists() else 'does not exist'}")
    try:
        if (size := file.stat().st_size) > MAX_BYTES:
            raise ConfigError(f"{file}: has {size} bytes; at most {MAX_BYTES} are allowed")
        text = _decoded(file, file.read_bytes())
    except OSError as exc:
        raise ConfigError(f"{file}: cannot be read: {exc.strerror or exc}") from exc
    return _Parser(file).parse(text)


def where(file: Path, element: ElementTree.Element | None) -> str:
    """The file and the element's line, as the beginning of a message."""
    line = element.line if isinstance(element, Element) else 0
    return f"{file}:{line}" if line else str(file)


def _decoded(file: Path, content: bytes) -> str:
    """The text, decoded with the encoding of the byte order mark or of the XML declaration, otherwise with
    UTF-8.
    """
    encoding = next((name for bom, name in BOMS.items() if content.startswith(bom)), None)
    if encoding is None and content[:2] in (b"<\0", b"\0<"):
        encoding = "utf-16-le" if content[0] else "utf-16-be"
    if encoding is None:
        found = DECLARATION.match(content[:1000])
        encoding = found[1].decode("ascii").lower() if found else "utf-8"
        if encoding.startswith(WIDE):
            encoding = "utf-8"
    try:
        if codecs.lookup(encoding).name in SLOW:
            raise LookupError
        return content.decode(encoding)
    except LookupError as exc:
        raise ConfigError(f"{file}:1: declares the unknown encoding {encoding!r}; save it as UTF-8") from exc
    except UnicodeError as exc:
        begin = getattr(exc, "start", 0)
        line = content.count(b"\n", 0, begin) + 1
        raise ConfigError(
            f"{file}:{line}: is not valid {encoding} text: {getattr(exc, 'reason', exc)}; save the file as "
            "UTF-8, or let its XML declaration name the encoding"
        ) from exc


class _Parser:
    """Builds the elements from the events of the expat parser."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._stack: list[Element] = []
        self._root: Element | None = None
        self._prefixes = {"xacro"}
        self._xacro_line = 0
        self._expat = expat.ParserCreate("utf-8")
        self._expat.StartElementHandler = self._start
        self._expat.EndElementHandler = self._end
        self._expat.StartDoctypeDeclHandler = self._doctype

    def parse(self, text: str) -> tuple[Element, int]:
        try:
            self._expat.Parse(text.encode("utf-8", "surrogatepass"), True)
        except expat.ExpatError as exc:
            raise ConfigError(
                f"{self._file}:{exc.lineno}: is not XML: {expat.ErrorString(exc.code)} in column "
                f"{exc.offset + 1}"
            ) from exc
        assert self._root is not None  # expat rejects a document without an element.
        return self._root, self._xacro_line

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self._expat.CurrentLineNumber
        if len(self._stack) >= MAX_DEPTH:
            raise ConfigError(f"{self._file}:{line}: elements are nested more than {MAX_DEPTH} deep")
        for name, value in attributes.items():
            if name.startswith("xmlns:") and XACRO.fullmatch(value):
                self._prefixes.add(name.removeprefix("xmlns:"))
        if not self._xacro_line and (self._is_xacro(tag) or any(map(_substituted, attributes.values()))):
            self._xacro_line = line
        element = Element(tag, {k: v for k, v in attributes.items() if k.partition(":")[0] != "xmlns"})
        element.line = line
        if self._stack:
            self._stack[-1].append(element)
        else:
            self._root = element
        self._stack.append(element)

    def _is_xacro(self, tag: str) -> bool:
        return tag.partition(":")[0] in self._prefixes and ":" in tag

    def _end(self, _tag: str) -> None:
        self._stack.pop()

    def _doctype(self, *_declared: object) -> None:
        line = self._expat.CurrentLineNumber
        raise ConfigError(f"{self._file}:{line}: has a DOCTYPE; remove it")


def _substituted(value: str) -> bool:
    """Whether an attribute contains a xacro substitution, ${...}."""
    begin = value.find("${")
    return begin >= 0 and "}" in value[begin:]


def number(
    file: Path, element: ElementTree.Element, attribute: str, of: str, default: float | None = None
) -> float:
    """The number in an attribute.

    Args:
        of: name of the thing that the element describes, such as "joint 'elbow'".
        default: the format's value for a missing attribute; None if the format requires it.

    Raises:
        ConfigError: the attribute is required but missing, or is not a single finite decimal number.
    """
    return numbers(file, element, attribute, of, 1, None if default is None else (default,))[0]


def numbers(
    file: Path,
    element: ElementTree.Element,
    attribute: str,
    of: str,
    count: int,
    default: tuple[float, ...] | None = None,
) -> tuple[float, ...]:
    """The numbers in an attribute, separated by spaces; see `number`."""
    text = element.get(attribute)
    what = f"{where(file, element)}: {of}: {attribute} of <{element.tag}>"
    if text is None:
        if default is None:
            raise ConfigError(f"{what} is missing; give {_amount(count)}")
        return default
    words = text.split()
    values = [float(word) for word in words if DECIMAL.fullmatch(word)]
    if len(words) != count or len(values) != count or not all(abs(value) <= MAX_NUMBER for value in values):
        raise ConfigError(f"{what} is {shown(text)}; it must be {_amount(count)} up to ±{MAX_NUMBER:g}")
    return tuple(values)


def shown(text: str) -> str:
    """A text from the file for a message: quoted, printable and short."""
    return ascii(text[:SHOWN]) + ("..." if len(text) > SHOWN else "")


def is_printable(name: str) -> bool:
    return 0 < len(name) <= 200 and name.isprintable() and name == name.strip()


def _amount(count: int) -> str:
    return "a decimal number" if count == 1 else f"{count} decimal numbers separated by spaces"


def format_numbers(values: tuple[float, ...]) -> str:
    """Format numbers for an attribute, at full precision."""
    return " ".join(map(repr, values))
