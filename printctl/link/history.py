"""The history of prints: an SQLite index of their journals, which can be made again from them.

The journals are the truth. Beside the index lies ``journals.txt``, to which the folder of every
print is appended before the index is touched; `History.rebuild` reads both it and the folders
that it is given. An index that can't be read is put aside and made again.

Any number of processes may write at once (SQLite's write-ahead log). Nothing here is in the way
of a print: `remember` never raises.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sqlite3
import sys
import threading
from collections.abc import Iterable, Iterator
from dataclasses import asdict, fields
from pathlib import Path
from typing import Final

from printctl.link.errors import HistoryError
from printctl.link.history_entry import INTERRUPTED, Alarm, PrintEntry, entry_of
from printctl.link.record import JOURNAL

DATA_VARIABLE: Final = "PRINTCTL_DATA"
_VERSION: Final = 1
_PATIENCE_S: Final = 5.0
_COLUMNS: Final = [field.name for field in fields(PrintEntry) if field.name != "alarms"]
_TABLES: Final = f"""
CREATE TABLE IF NOT EXISTS prints ({", ".join(_COLUMNS)}, PRIMARY KEY (id));
CREATE TABLE IF NOT EXISTS alarms (id, n INTEGER, at REAL, text, PRIMARY KEY (id, n));
PRAGMA user_version = {_VERSION};
"""
_FOUND_IN: Final = ("who", "host", "file", "path", "sha256", "profile", "port", "state", "message")

log = logging.getLogger(__name__)


def data_folder() -> Path:
    """Where the index lies: ``PRINTCTL_DATA``, or the system's folder for a user's data."""
    given = os.environ.get(DATA_VARIABLE)
    if given:
        return Path(given)
    home = Path.home()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", home / "AppData" / "Local")) / "printctl"
    if sys.platform == "darwin":
        return home / "Library" / "Application Support" / "printctl"
    return Path(os.environ.get("XDG_DATA_HOME", home / ".local" / "share")) / "printctl"


class PrintHistory:
    """The index in a folder.

    Parameters
    ----------
    folder : Path, optional
        `data_folder` by default; made if absent.

    Raises
    ------
    HistoryError
        When the folder can't be used, here and in all methods.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder or data_folder()
        self.path, self._folders = self.folder / "history.db", self.folder / "journals.txt"
        with self._told():
            self.folder.mkdir(parents=True, exist_ok=True)
            try:
                self._prepare()
            except sqlite3.OperationalError:
                raise  # busy, full or not allowed: no reason to throw it away
            except sqlite3.DatabaseError:
                self._put_aside()
                self.rebuild()

    def note(self, print_folder: Path) -> None:
        """Take in what the journals of a print's folder say now."""
        with self._told():
            self._remember_folder(print_folder.resolve())
            self._take_in(_journals(print_folder))

    def rebuild(self, roots: Iterable[Path] = ()) -> int:
        """Make the index again from the journals; give how many prints there are.

        Prints whose journal can't be found any more stay as they were last known.

        Parameters
        ----------
        roots : paths, optional
            Folders to search, with all below them, beside those that are known.
        """
        with self._told():
            for root in roots:
                for journal in sorted(root.rglob(f"{Path(JOURNAL).stem}*.log")):
                    self._remember_folder(journal.parent.resolve())
            self._take_in(j for folder in self._known_folders() for j in _journals(folder))
            with self._open() as index:
                return int(index.execute("SELECT count(*) FROM prints").fetchone()[0])

    def entries(self, search: str = "") -> list[PrintEntry]:
        """Prints, the latest first, whose every word of ``search`` is found somewhere.

        What the index has without an end is read again from its journal first.
        """
        with self._told():
            with self._open() as index:
                open_ones = index.execute(
                    "SELECT journal FROM prints WHERE state = ?", (INTERRUPTED,)
                ).fetchall()
            self._take_in(j for (one,) in open_ones for j in _journals(Path(one).parent))
            return self._found(search)

    # --- the index -------------------------------------------------------------------------

    def _found(self, search: str) -> list[PrintEntry]:
        places = [f"p.{name}" for name in _FOUND_IN]
        places.append("(SELECT group_concat(a.text) FROM alarms a WHERE a.id = p.id)")
        text = " || ' ' || ".join(f"coalesce({place}, '')" for place in places)
        words = search.split()
        wanted = " AND ".join([f"instr(lower({text}), lower(?)) > 0"] * len(words)) or "1"
        query = f"SELECT {', '.join(_COLUMNS)} FROM prints p WHERE {wanted} ORDER BY started DESC"
        with self._open() as index:
            rows = index.execute(query, words).fetchall()
            return [self._entry(index, row) for row in rows]

    def _entry(self, index: sqlite3.Connection, row: tuple[object, ...]) -> PrintEntry:
        values = dict(zip(_COLUMNS, row, strict=True))
        alarms = index.execute(
            "SELECT at, text FROM alarms WHERE id = ? ORDER BY n", (values["id"],)
        ).fetchall()
        values["journal"] = Path(str(values["journal"]))
        return PrintEntry(**values, alarms=tuple(Alarm(*alarm) for alarm in alarms))  # type: ignore[arg-type]

    def _take_in(self, journals: Iterable[Path]) -> None:
        found = []
        for journal in journals:
            with contextlib.suppress(OSError):  # moved away since: the last known stays
                found.append(entry_of(journal))
        with self._open() as index:
            for entry in filter(None, found):
                _put(index, entry)

    def _prepare(self) -> None:
        with self._open() as index:
            version = index.execute("PRAGMA user_version").fetchone()[0]
            if version == 0:
                index.executescript(_TABLES)
            tables = {row[0] for row in index.execute("SELECT name FROM sqlite_master")}
            if version not in (0, _VERSION) or not {"prints", "alarms"} <= tables:
                raise sqlite3.DatabaseError(f"version {version} with tables {sorted(tables)}")

    @contextlib.contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """A connection for one transaction."""
        index = sqlite3.connect(self.path, timeout=_PATIENCE_S)
        try:
            index.execute("PRAGMA journal_mode = WAL")
            with index:
                yield index
        finally:
            index.close()

    def _put_aside(self) -> None:
        count = len(list(self.folder.glob("history.damaged-*.db")))
        for suffix in ("-wal", "-shm"):
            self.path.with_name(self.path.name + suffix).unlink(missing_ok=True)
        self.path.rename(self.folder / f"history.damaged-{count + 1}.db")
        self._prepare()

    # --- where the journals are --------------------------------------------------------------

    def _remember_folder(self, folder: Path) -> None:
        if str(folder) not in map(str, self._known_folders()):
            with self._folders.open("ab") as handle:
                handle.write(os.fsencode(folder) + b"\n")

    def _known_folders(self) -> list[Path]:
        try:
            lines = self._folders.read_bytes().splitlines()
        except FileNotFoundError:
            return []
        return [Path(os.fsdecode(line)) for line in dict.fromkeys(lines) if line]

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, OSError) as exc:
            raise HistoryError(
                f"the history in {self.folder} can't be used: {exc}; the journals are untouched; "
                "see to the folder (PRINTCTL_DATA moves it), then `printctl history rebuild`"
            ) from exc


def remember(print_folder: Path) -> None:
    """Take a print into the history; what goes wrong is logged and disturbs nothing."""
    try:
        PrintHistory().note(print_folder)
    except Exception:
        log.exception("the print isn't in the history; `printctl history rebuild` will find it")


def remember_meanwhile(print_folder: Path) -> threading.Thread:
    """`remember` in a thread of its own, which doesn't keep the process alive."""
    thread = threading.Thread(target=remember, args=(print_folder,), name="history", daemon=True)
    thread.start()
    return thread


def _journals(folder: Path) -> list[Path]:
    """The folder's journals: the last print's, and those put aside by number."""
    return sorted(folder.glob(f"{Path(JOURNAL).stem}*.log"))


def _put(index: sqlite3.Connection, entry: PrintEntry) -> None:
    values = asdict(entry) | {"journal": str(entry.journal.resolve())}
    marks = ", ".join("?" * len(_COLUMNS))
    index.execute(
        f"INSERT OR REPLACE INTO prints ({', '.join(_COLUMNS)}) VALUES ({marks})",
        [values[name] for name in _COLUMNS],
    )
    index.execute("DELETE FROM alarms WHERE id = ?", (entry.id,))
    index.executemany(
        "INSERT INTO alarms VALUES (?, ?, ?, ?)",
        [(entry.id, n, alarm.at, alarm.text) for n, alarm in enumerate(entry.alarms)],
    )
