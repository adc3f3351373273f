"""Origin of a request to a print or printer: who makes it, and from where.

What a client says is written down as it is: whoever may open the process's socket may say anything.
"""

from __future__ import annotations

import getpass
import os
import platform
import sys
from contextvars import ContextVar
from pathlib import Path
from typing import Final

ACTOR: Final[ContextVar[dict[str, str] | None]] = ContextVar("actor", default=None)
"""Who asks by a page, or has answered a look: set for what is done on that account."""
_LETTERS: Final = 200


def this_user() -> dict[str, str]:
    """Return who prints here: ``who``, ``host``."""
    try:
        who = getpass.getuser()
    except (OSError, KeyError, ImportError):  # a container's user may have no name
        who = ""
    return {"who": who, "host": platform.node()}


def actor() -> dict[str, str]:
    """Return ``who`` asks and ``from`` where: a page's visitor, else this process's user."""
    if given := ACTOR.get():
        return given
    try:
        terminal = f"terminal {os.ttyname(0)}"
    except (OSError, AttributeError):  # none, or Windows
        terminal = "no terminal"
    if caller := os.environ.get("SSH_CONNECTION", "").split():
        terminal += f" by ssh from {caller[0]}"
    program = Path(sys.argv[0] or "python")
    name = program.parent.name if program.stem == "__main__" else program.stem
    user = this_user()
    return {"who": user["who"], "from": f"{terminal} of {user['host']}, {name} {os.getpid()}"}


def read_actor(given: object) -> dict[str, str]:
    """Return ``who`` and ``from`` as somebody else wrote them; empty for what can't be read."""
    values = given if isinstance(given, dict) else {}
    return {key: str(values.get(key, ""))[:_LETTERS] for key in ("who", "from")}
