"""Remove tokens, passwords and cookies from log messages."""

from __future__ import annotations

import logging
import re
from typing import Final

_SECRETS: Final = re.compile(
    r"((?:token|password)=|bearer\s+|printctl_\d+=)[^&\s\"';]+", re.IGNORECASE
)


def scrubbed(text: str) -> str:
    """``text`` without tokens, passwords and cookies."""
    return _SECRETS.sub(r"\1***", text)


class Scrubbing(logging.Filter):
    """Changes a record before it is written."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Take out secrets; every record passes."""
        record.msg, record.args = scrubbed(record.getMessage()), ()
        return True
