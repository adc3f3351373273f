"""Read an interrupted print's journal; refuse a print that cannot be resumed."""

from __future__ import annotations

from pathlib import Path

from printctl.machine.errors import Refused
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import JournalledPrint, read_journal
from printctl.machine.records.states import LinkState


def resumable(folder: Path, sha256: str) -> JournalledPrint:
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
    Refused
        When the print has ended in another way, was being ended, was never begun, or was of
        another file, or when records are missing in its journal.
    JournalError
        When there is no journal.
    """
    history = read_journal(folder / JOURNAL)
    end = history.end
    if end is not None and (end["position_known"] or history.state is not LinkState.FAILED):
        raise Refused(
            f"the print in {folder} has ended ({history.state.value}: {history.message}); it "
            f"can't be gone on with: {_remedy(history)}"
        )
    if history.stopping:
        raise Refused(
            f"the print in {folder} was being ended ({history.message}): its heaters may be off "
            "and its needle up; print it anew"
        )
    if history.cut_short:
        raise Refused(
            f"the disk was full, and how the print in {folder} went on isn't in its journal: its "
            "needle may be up and its heaters off; look at the part and use `printctl recover`"
        )
    if history.gaps:
        raise Refused(
            f"the journal in {folder} is damaged in {history.gaps} places, so that its lines can't "
            "be counted; see `printctl recover`, and to the disk"
        )
    if not history.begun:
        raise Refused(f"no line of the job was sent in {folder}; print it anew")
    if history.job.get("sha256") != sha256:
        raise Refused(
            f"the print in {folder} was of another file ({history.job.get('name')}, hash "
            "differs); give that file, or print anew in another folder"
        )
    return history


def _remedy(history: JournalledPrint) -> str:
    """What is left to do with a print that has ended."""
    whole = history.state is LinkState.DONE
    return "print it anew" if whole else "`printctl recover` writes its rest, or print it anew"
