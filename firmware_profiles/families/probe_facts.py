"""Record type of a firmware's settings queries, and reply phrases mapped to profile keys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class ProbeFacts:
    """Questions, none of which sets anything.

    Attributes
    ----------
    questions : tuple of bytes
    phrases : mapping of str to str
        Words before a number, and the profile's key for it, where it doesn't list its settings as
        the commands that would set them.
    """

    questions: tuple[bytes, ...] = ()
    phrases: Mapping[str, str] = field(default_factory=dict)
