"""Detect a file's type by its first bytes, whatever its name."""

from __future__ import annotations

from typing import Final, Literal

Kind = Literal[
    "png", "jpeg", "webp", "zip", "gzip", "tiff", "hdf5", "nifti", "nrrd", "dicom", "numpy",
    "pdf", "text", "other",
]  # fmt: skip

HEAD_BYTES: Final = 512
"""So many suffice to tell."""

_SIGNS: Final[tuple[tuple[int, bytes, Kind], ...]] = (
    (0, b"\x89PNG\r\n\x1a\n", "png"),
    (0, b"\xff\xd8\xff", "jpeg"),
    (8, b"WEBP", "webp"),
    (0, b"PK\x03\x04", "zip"),
    (0, b"PK\x05\x06", "zip"),
    (0, b"\x1f\x8b", "gzip"),
    (0, b"II*\x00", "tiff"),
    (0, b"MM\x00*", "tiff"),
    (0, b"II+\x00", "tiff"),
    (0, b"MM\x00+", "tiff"),
    (0, b"\x89HDF\r\n\x1a\n", "hdf5"),
    (344, b"n+1\x00", "nifti"),
    (4, b"n+2\x00", "nifti"),
    (0, b"NRRD", "nrrd"),
    (128, b"DICM", "dicom"),
    (0, b"\x93NUMPY", "numpy"),
    (0, b"%PDF-", "pdf"),
)


def kind_of(head: bytes) -> Kind:
    """Return a file's type from its first `HEAD_BYTES`; ``text`` is UTF-8 without control codes."""
    for place, sign, kind in _SIGNS:
        if head[place : place + len(sign)] == sign:
            return kind
    try:
        text = head.decode("utf-8")
    except UnicodeDecodeError as exc:
        if len(head) < HEAD_BYTES or exc.reason != "unexpected end of data":
            return "other"  # else the head's end cuts a character
        text = head[: exc.start].decode("utf-8")
    return "text" if all(c.isprintable() or c in "\t\r\n\f\ufeff" for c in text) else "other"
