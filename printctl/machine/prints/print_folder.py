"""Find the print that a user means, by its folder, its run folder or its G-code file."""

from __future__ import annotations

from pathlib import Path

from printctl.errors import PrintctlError
from printctl.machine.process.client import PrintClient, attach
from printctl.machine.records.record import RECORD
from printctl.machine.records.states import LinkState


def print_folder(run: Path) -> Path:
    """Folder of the print's journal; where one should be when none is found."""
    beside = Path(f"{run}.print") if run.is_file() else run
    folders = (place for place in (run, run / "print", beside) if (place / RECORD).is_file())
    return next(folders, beside)


def running_print(run: Path) -> PrintClient:
    """A client of a print that is going on.

    Raises
    ------
    PrintctlError
        When it has ended.
    LinkError
        When no print was ever started there.
    """
    client = attach(print_folder(run))
    status = client.status
    if status.ended:
        still = status.position_known or status.state is LinkState.KILLED
        halts = "" if still else "; if anything moves, `printctl kill` halts it"
        raise PrintctlError(
            f"the print in {client.folder} has ended ({status.state.value}: {status.message})"
            f"{halts}"
        )
    return client
