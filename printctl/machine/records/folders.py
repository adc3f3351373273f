"""Folders of prints: where they are listed, their journals by number, the operator's notes.

A folder's last print has ``journal.log`` and ``record.json``; of those before, both were put aside
by one number: ``journal.2.log`` and ``record.2.json``. All folders of a user's prints stand in
``journals.txt``, from which the history is made.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from printctl.machine.records.journal import Record, print_id, read_records
from printctl.machine.records.record import JOURNAL

NOTED: Final = "record.json"
TIMELAPSE: Final = "timelapse"
DATA_VARIABLE: Final = "PRINTCTL_DATA"
AGAIN_S: Final = 10.0
"""Interval in which a print is listed again that couldn't be."""
_LIST: Final = "journals.txt"
_MAX_NOTES_BYTES: Final = 16 * 2**20

log = logging.getLogger(__name__)


def data_folder() -> Path:
    """Folder of what is kept of a user: ``PRINTCTL_DATA``, or the system's for a user's data."""
    given = os.environ.get(DATA_VARIABLE)
    if given:
        return Path(given)
    home = Path.home()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", home / "AppData" / "Local")) / "printctl"
    if sys.platform == "darwin":
        return home / "Library" / "Application Support" / "printctl"
    return Path(os.environ.get("XDG_DATA_HOME", home / ".local" / "share")) / "printctl"


def known_folders(data: Path) -> list[Path]:
    """Return the folders of prints that ``data`` lists, each once; raises `OSError`."""
    try:
        lines = (data / _LIST).read_bytes().splitlines()
    except FileNotFoundError:
        return []
    return [Path(os.fsdecode(line)) for line in dict.fromkeys(lines) if line]


def add_folder(folder: Path, data: Path) -> None:
    """List a print's folder (resolved) in ``data``, where it isn't; raises `OSError`."""
    if str(folder) not in map(str, known_folders(data)):
        data.mkdir(0o700, parents=True, exist_ok=True)
        with (data / _LIST).open("ab") as handle:
            handle.write(os.fsencode(folder) + b"\n")


def remember_folder(
    folder: Path, on_failure: Callable[[str], None] = log.error
) -> threading.Thread:
    """List a print's folder for the history, in a thread: a slow disk delays no print.

    Where the data folder can't be written (full, read-only) it is tried again for as long as the
    process lives; ``on_failure`` is told once, in words.
    """
    data = data_folder()

    def work() -> None:
        told = False
        while True:
            try:
                add_folder(folder.resolve(), data)
            except OSError as exc:
                if not told:
                    on_failure(
                        f"the print isn't in the history yet: {data} can't be written "
                        f"({exc.strerror}); it is filed once it can, and after the print by "
                        f"`printctl history rebuild {folder}`"
                    )
                told = True
                time.sleep(AGAIN_S)
            else:
                return

    thread = threading.Thread(target=work, name="history", daemon=True)
    thread.start()
    return thread


def journals_in(folder: Path) -> list[Path]:
    """Return a folder's journals: the last print's, and those put aside by number."""
    return sorted(folder.glob(f"{Path(JOURNAL).stem}*.log"))


def notes_path(journal: Path) -> Path:
    """Path of the record of a journal's print, whether it exists or not."""
    number = journal.name.removeprefix(Path(JOURNAL).stem).removesuffix(".log")
    return journal.with_name(f"record{number}.json")


def read_notes(journal: Path) -> dict[str, Any]:
    """What was noted of a journal's print; empty where nothing was, or it can't be read."""
    path = notes_path(journal)
    try:
        if path.stat().st_size > _MAX_NOTES_BYTES:
            return {}
        notes = json.loads(path.read_text(encoding="utf-8"), parse_constant=lambda _: None)
    except (OSError, ValueError, RecursionError):
        return {}
    return notes if isinstance(notes, dict) else {}


def archive_journal(folder: Path) -> Path:
    """Give an earlier print's journal and record a number, and the path of the new journal."""
    path = folder / JOURNAL
    if path.exists():
        count = len(list(folder.glob(f"{path.stem}.*{path.suffix}")))
        aside = folder / f"{path.stem}.{count + 1}{path.suffix}"
        if notes_path(path).exists():
            notes_path(path).replace(notes_path(aside))
        path.rename(aside)
    return path


def journal_of(folder: Path, identity: str, at: float) -> Path:
    """Return the journal of the print with an identity; the present journal where there is none.

    Without an identity that of the last print begun by ``at``, s since 1970.
    """
    begun = {}
    for path in journals_in(folder):
        first = first_job_record(path)
        if identity and first and print_id(first) == identity:
            return path
        with contextlib.suppress(TypeError, ValueError):
            begun[float(first.get("started", 0.0))] = path
    earlier = [started for started in begun if 0.0 < started <= at and not identity]
    return begun[max(earlier)] if earlier else folder / JOURNAL


def print_identity(folder: Path) -> dict[str, Any] | None:
    """Return a print's ``id``, ``started`` (s since 1970), ``gcode_sha256``; None without one."""
    first = first_job_record(folder / JOURNAL)
    if not first:
        return None
    return {
        "id": print_id(first),
        "started": float(first.get("started", 0.0)) or None,
        "gcode_sha256": plain_text(first.get("sha256", "")),
    }


def plain_text(value: object) -> str:
    """A value as text that can be written anywhere; file names may hold other bytes than UTF-8."""
    return str(value).encode("utf-8", "replace").decode("utf-8")


def first_job_record(journal: Path) -> Record:
    """Return the record with which a journal's print began; empty where it can't be read."""
    try:
        records = read_records(journal)
        return next((one for one in records if one and one.get("t") == "job"), {})
    except OSError:
        return {}


def frames_folder(folder: Path, started: float) -> Path:
    """Folder of a print's time-lapse pictures ``000001.jpg`` and so on.

    ``started``, s since 1970, is when the print's journal says that it began.
    """
    return folder / TIMELAPSE / time.strftime("%Y%m%d-%H%M%S", time.gmtime(started))


def film_file(folder: Path, started: float) -> Path:
    """The film made of them; there only once the print has ended."""
    frames = frames_folder(folder, started)
    return frames.with_name(frames.name + ".webp")
