"""Parse request cookies; standard library only, because the stop process uses it, too."""

from __future__ import annotations

import re


def cookie_of(header: str, name: str) -> str:
    """A cookie's value in a ``Cookie`` header; empty without.

    Other servers' cookies of the same host are in it, too, and may be malformed.
    """
    match = re.search(rf"(?:^|;\s*){re.escape(name)}=([^;\s]*)", header)
    return match[1] if match else ""
