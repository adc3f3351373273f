"""Whether the print in a folder can be gone on with."""

from __future__ import annotations

from pathlib import Path

from printctl.link.errors import LinkError
from printctl.link.journal import History, read_journal
from printctl.link.record import JOURNAL
from printctl.link.states import LinkState


def resumable(folder: Path, sha256: str) -> History:
    """Read the journal of a print that was interrupted.

    Interrupted is a print whose link process died, whose port went away, or whose printer fell
    silent. The printer itself is asked later.

    Parameters
    ----------
    folder : Path
    sha256 : str
        Of the job file that is to be gone on with.

    Raises
    ------
    LinkError
        When the print has ended in another way, was never begun, or was of another file.
    JournalError
        When there is no journal.
    """
    history = read_journal(folder / JOURNAL)
    end = history.end
    if end is not None and (end["position_known"] or history.state is not LinkState.FAILED):
        hint = "" if end["position_known"] else ", or see `printctl recover`"
        raise LinkError(
            f"the print in {folder} has ended ({history.state.value}: {history.message}); it "
            f"can't be gone on with, print it anew{hint}"
        )
    if not history.begun:
        raise LinkError(f"no line of the job was sent in {folder}; print it anew")
    if history.job.get("sha256") != sha256:
        raise LinkError(
            f"the print in {folder} was of another file ({history.job.get('name')}, hash "
            "differs); give that file, or print anew in another folder"
        )
    return history
