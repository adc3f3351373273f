"""Tables of known firmware messages (``data/messages``): what each means for a print."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Final

from firmware_profiles.yaml_file import read_yaml

_FOLDER: Final = Path(__file__).resolve().parents[1] / "data" / "messages"


class MessageMeaning(StrEnum):
    """What a firmware's message means for a print."""

    HALT = "halt"
    """It has stopped for good; only a reset brings it back."""
    FAULT = "fault"
    """Something is wrong with the printer: the print ends."""
    REFUSAL = "refusal"
    """A command wasn't carried out. In a print it ends it; of a question it is an answer."""
    LINE_ERROR = "line_error"
    """A line was garbled on its way; the protocol sends it again."""
    NOTICE = "notice"
    """Somebody should know; nothing ends."""
    IGNORE = "ignore"
    """Ordinary chatter."""


COMPLAINTS: Final = frozenset({MessageMeaning.HALT, MessageMeaning.FAULT, MessageMeaning.REFUSAL})
"""Meanings that count whatever else stands in the line, and in every state of a link."""


@dataclass(frozen=True)
class KnownMessage:
    """One row of a table, found in a line.

    Attributes
    ----------
    meaning : MessageMeaning
    command : bytes or None
        The command that a refusal quotes; None where its text quotes none.
    """

    meaning: MessageMeaning
    command: bytes | None = None


class MessageTable:
    """Messages of one family, the first row that fits counting.

    Parameters
    ----------
    rows : sequence of dict
        ``text`` (a regular expression), ``meaning``, ``source``.
    """

    def __init__(self, rows: list[dict[str, str]]) -> None:
        self._rows = [(_pattern(row["text"]), MessageMeaning(row["meaning"])) for row in rows]
        named = re.compile(r"\?P<\w+>")
        self._any = _pattern("|".join(f"(?:{named.sub('?:', row['text'])})" for row in rows))

    def find(self, text: bytes) -> KnownMessage | None:
        """Return what is known of a line, its first row; None for nothing."""
        if not self._any.search(text):
            return None
        for pattern, meaning in self._rows:
            if match := pattern.search(text):
                return KnownMessage(meaning, match.groupdict().get("command"))
        return None


def _pattern(text: str) -> re.Pattern[bytes]:
    return re.compile(text.encode("ascii"), re.IGNORECASE | re.DOTALL)


@cache
def load_messages(*families: str) -> MessageTable:
    """Return the rows of the first family's file, then of those whose messages it has as well."""
    texts = [(_FOLDER / f"{name}.yaml").read_text(encoding="utf-8") for name in families]
    return MessageTable([row for text in texts for row in read_yaml(text)])
