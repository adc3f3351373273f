"""Confirmation of the set-up of a job or sheet that doesn't record it."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from typing import Annotated

from printctl.checks.kinds import Kind
from printctl.checks.made_for import MadeFor
from printctl.cli.options import messages
from printctl.errors import SafetyError
from printctl.machine.prints.mounted import is_confirmed, keep_confirmed, unconfirmed
from printctl.settings import opt

ForMountedFlag = Annotated[
    bool,
    opt("Confirm that a file which doesn't record its set-up was made for what is mounted."),
]


def confirm_set_up(file: Path, mounted: MadeFor, for_mounted: bool) -> None:
    """Have a person confirm, once, the set-up of a file that doesn't record it.

    Raises
    ------
    SafetyError
        Without ``for_mounted`` and without an answer at the terminal.
    """
    sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
    if is_confirmed(sha256, mounted):
        return
    words = unconfirmed(file.name, mounted)
    if not for_mounted:
        answer = ""
        if sys.stdin.isatty():
            question = f"{words}. Was it made for that? Type yes to confirm: "
            answer = messages().input(question, markup=False)
        if answer.strip().lower() != "yes":
            raise SafetyError(
                f"{words}; if it was made for that, add --for-mounted (asked once for each file)",
                (Kind.UNRECORDED,),
            )
    keep_confirmed(sha256, mounted)
