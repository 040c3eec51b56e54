"""Errors of the wire layer; the layer above translates them.

RtpsError
├── MalformedError       a datagram violates the protocol; it is counted and never leaves the package
├── SampleTooLargeError  a sample is larger than the participant accepts
├── ClosedError          the participant, writer or reader is closed
└── NetworkError         no port is free, or the interface does not exist
"""

from __future__ import annotations


class RtpsError(Exception):
    """Base class of all errors in this package. The message is for people."""


class MalformedError(RtpsError):
    pass


class SampleTooLargeError(RtpsError):
    pass


class ClosedError(RtpsError):
    pass


class NetworkError(RtpsError):
    pass
