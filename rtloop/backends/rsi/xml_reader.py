"""Reads the subset of XML that RSI's telegrams use: a root, and elements with attributes or text, without
deeper levels.

Packets are parsed with Expat. All other XML content (document types and therefore entities, processing
instructions, deeper levels) is rejected, as are large packets.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.parsers import expat

MAX_PACKET = 8192
"""Maximum size of a telegram, in bytes. A telegram with all 64 RSI channels takes about half of that."""
MAX_ELEMENTS = 200
MAX_TEXT = 200
SHOWN = 60


class TelegramError(Exception):
    """Raised if a packet is not a telegram. The text gives the reason."""


@dataclass(slots=True)
class TelegramElement:
    """An element below the root.

    Attributes:
        attributes: attributes by name, not yet parsed.
        text: text between its tags.
    """

    attributes: dict[str, str]
    text: str = ""


@dataclass(slots=True)
class Telegram:
    """A parsed packet.

    Attributes:
        root: name of the root.
        type: the attribute `Type`; "" if it is missing.
        elements: elements by name.
    """

    root: str = ""
    type: str = ""
    elements: dict[str, TelegramElement] = field(default_factory=dict)


def shown(value: object) -> str:
    """Return a short, printable form of a value from an untrusted packet."""
    text = str(value)
    return ascii(text if len(text) <= SHOWN else f"{text[:SHOWN]}...")


def read_telegram(packet: bytes) -> Telegram:
    """Parse a packet. Raises TelegramError if the packet is not a telegram."""
    if len(packet) > MAX_PACKET:
        raise TelegramError(f"the packet is longer than {MAX_PACKET} bytes")
    reader = _Reader()
    try:
        reader.parser.Parse(packet, True)
    except expat.ExpatError as exc:
        raise TelegramError(
            f"the packet is not XML ({exc}); its first bytes are {shown(packet[:20])}"
        ) from exc
    except (ValueError, LookupError) as exc:  # an encoding that Python does not know
        raise TelegramError(f"the packet is not XML ({exc})") from exc
    return reader.telegram


class _Reader:
    """Collects the elements from Expat's events."""

    def __init__(self) -> None:
        self.telegram = Telegram()
        self._open: TelegramElement | None = None
        self._depth = 0
        self.parser = parser = expat.ParserCreate("utf-8")
        parser.buffer_text = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text
        parser.StartDoctypeDeclHandler = self._reject_doctype
        parser.ProcessingInstructionHandler = self._reject_instruction

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        telegram = self.telegram
        self._depth += 1
        if self._depth == 1:
            telegram.root, telegram.type = name, attributes.get("Type", "")
            return
        if self._depth > 2:
            raise TelegramError(
                f"{shown(name)} is inside another element; a telegram's elements must not be nested"
            )
        if name in telegram.elements:
            raise TelegramError(f"{shown(name)} occurs twice")
        if len(telegram.elements) == MAX_ELEMENTS:
            raise TelegramError(f"the telegram contains more than {MAX_ELEMENTS} elements")
        self._open = telegram.elements[name] = TelegramElement(attributes)

    def _end(self, name: str) -> None:
        self._depth -= 1
        self._open = None

    def _text(self, text: str) -> None:
        if self._open is None:
            return
        self._open.text += text
        if len(self._open.text) > MAX_TEXT:
            raise TelegramError(f"an element's text is longer than {MAX_TEXT} characters")

    @staticmethod
    def _reject_doctype(name: str, system: str | None, public: str | None, internal: bool) -> None:
        raise TelegramError("the telegram contains a document type declaration, which is not allowed")

    @staticmethod
    def _reject_instruction(target: str, data: str) -> None:
        raise TelegramError(
            f"the telegram contains a processing instruction, {shown(target)}, which is not allowed"
        )
