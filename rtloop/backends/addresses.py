"""Checks of the controller addresses in backend options."""

from __future__ import annotations

from ipaddress import IPv4Address, ip_address
from typing import Annotated

from pydantic import AfterValidator


def an_ipv4_address(value: str) -> str:
    try:
        IPv4Address(value)
    except ValueError as exc:
        raise ValueError(f"{value[:80]!r} is not an IPv4 address, such as 172.31.1.147") from exc
    return value


Address = Annotated[str, AfterValidator(an_ipv4_address)]


def is_of_this_computer(address: object) -> bool:
    """Whether an address in a backend's options can only mean this computer."""
    try:
        return address == "localhost" or ip_address(str(address)).is_loopback
    except ValueError:
        return False
