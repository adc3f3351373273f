"""Hash chain of a journal's lines."""

from __future__ import annotations

import hashlib
from typing import Final

BEGIN: Final = bytes(32)
"""The chain's hash before the first line."""
_SHOWN: Final = 16


def link(head: bytes, line: bytes) -> bytes:
    """Return the chain's hash after a line: SHA-256 of the one before and its bytes, no line end.

    Torn lines count as they are.
    """
    return hashlib.sha256(head + line).digest()


def shown(head: bytes) -> str:
    """Return what a line holds of the hash before it: 64 bits tell where a change begins.

    A signature is of all 256.
    """
    return head[: _SHOWN // 2].hex()
