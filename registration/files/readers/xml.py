"""Parse small XML headers without entities and with a size limit."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from registration.errors import ScanFileError

MOST_XML_BYTES = 64 << 20
"""No header is longer."""


def parse_xml(text: bytes | str, source: str | Path) -> ElementTree.Element:
    """The root of an XML header.

    Raises
    ------
    ScanFileError
        When it isn't XML, is far too long, or declares entities (which can grow without end).
    """
    data = text.encode() if isinstance(text, str) else text
    if len(data) > MOST_XML_BYTES:
        raise ScanFileError(f"{source}: its XML header has {len(data)} bytes; export it again")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ScanFileError(f"{source}: its XML header declares entities; no scanner writes them")
    try:
        return ElementTree.fromstring(data)
    except ElementTree.ParseError as exc:
        raise ScanFileError(f"{source}: broken XML header ({exc}); export it again") from exc
