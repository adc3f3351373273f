"""Index of past prints (SQLite) to list and search them, rebuilt from journals if need be.

The journals are the truth. Beside the index lies ``journals.txt``, to which each print appends its
folder when it begins; whoever reads the index first takes in what was printed since.
`PrintHistory.rebuild` reads all again, also of the folders that it is given. An index that can't be
read is put aside and made again. Any number of processes may write at once (SQLite's write-ahead
log).
"""

from __future__ import annotations

import contextlib
import json
import logging
import sqlite3
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final, Literal

from printctl.history.query import COLUMN_OF, OPERATOR, HistoryPage, HistoryQuery, below_any
from printctl.machine.errors import HistoryError, NoSuchPrint
from printctl.machine.records.folders import add_folder, data_folder, journals_in, known_folders
from printctl.machine.records.record import JOURNAL
from printctl.pipeline.past.past_print import INTERRUPTED, Alarm, PrintEntry, entry_of

_VERSION: Final = 1
_BUSY_LIMIT_S: Final = 20.0
"""For another process that writes: SQLite's waiting is not in turns, and a busy disk slow."""
_COLUMNS: Final = [
    field.name for field in fields(PrintEntry) if field.name not in ("alarms", "operator")
]
_TABLES: Final = f"""
CREATE TABLE IF NOT EXISTS prints ({", ".join(_COLUMNS)}, PRIMARY KEY (id));
CREATE TABLE IF NOT EXISTS alarms (id, n INTEGER, at REAL, text, PRIMARY KEY (id, n));
PRAGMA user_version = {_VERSION};
"""
_HELPERS: Final = """
CREATE TABLE IF NOT EXISTS operators (id, name, PRIMARY KEY (id));
CREATE TABLE IF NOT EXISTS seen (journal, size INTEGER, changed INTEGER, PRIMARY KEY (journal));
CREATE INDEX IF NOT EXISTS by_start ON prints (started);
CREATE INDEX IF NOT EXISTS alarms_of ON alarms (id);
"""
"""Operators by the prints' records; how a journal was when it was last read, so that it isn't read
again as long as it is so."""

_SELECTED: Final = f"{', '.join(f'p.{name}' for name in _COLUMNS)}, coalesce({OPERATOR}, '')"

_GONE: Final = (None, None)
"""Stamp of a journal that isn't there."""

log = logging.getLogger(__name__)


class PrintHistory:
    """History index in a folder.

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
        self.path = self.folder / "history.db"
        with self._errors_named():
            self.folder.mkdir(0o700, parents=True, exist_ok=True)
            try:
                self._prepare()
            except sqlite3.OperationalError:
                raise  # busy, full or not allowed: no reason to throw it away
            except sqlite3.DatabaseError:
                self._put_aside()
                self.rebuild()

    def note(self, print_folder: Path) -> None:
        """Take in what the journals of a print's folder say now."""
        with self._errors_named():
            add_folder(print_folder.resolve(), self.folder)
            self._take_in(journals_in(print_folder))

    def rebuild(self, roots: Iterable[Path] = ()) -> int:
        """Make the index again from the journals; give how many prints there are.

        Prints whose journal can't be found any more stay as they were last known.

        Parameters
        ----------
        roots : paths, optional
            Folders to search, with all below them, beside those that are known.
        """
        with self._errors_named():
            for root in roots:
                for journal in sorted(root.rglob(f"{Path(JOURNAL).stem}*.log")):
                    add_folder(journal.parent.resolve(), self.folder)
            self._take_in(j for folder in known_folders(self.folder) for j in journals_in(folder))
            with self._open() as index:
                return int(index.execute("SELECT count(*) FROM prints").fetchone()[0])

    def entries(self, search: str = "") -> list[PrintEntry]:
        """Prints, the latest first, whose every word of ``search`` is found somewhere."""
        return list(self.find(HistoryQuery(words=search)).entries)

    def find(self, query: HistoryQuery) -> HistoryPage:
        """Prints that are asked for, a page of them.

        What the index has without an end is read again first, if its journal has grown.
        """
        with self._errors_named():
            self._catch_up()
            with self._open() as index:
                where, values = query.condition()
                count = f"SELECT count(*) FROM prints p WHERE {where}"
                total = int(index.execute(count, values).fetchone()[0])
                rows = index.execute(
                    f"SELECT {_SELECTED} FROM prints p WHERE {where} {query.order()}",
                    values,
                ).fetchall()
                return HistoryPage(tuple(_entries(index, rows)), total)

    def one(self, print_id: str) -> PrintEntry:
        """One print, by its id or so much of it that no other begins so.

        Raises
        ------
        HistoryError
            When there is none, or more than one.
        """
        with self._errors_named():
            self._catch_up()
            with self._open() as index:
                rows = index.execute(
                    f"SELECT {_SELECTED} FROM prints p WHERE p.id >= ? AND p.id < ? LIMIT 2",
                    [print_id, f"{print_id}\x7f"],
                ).fetchall()
                entries = _entries(index, rows) if print_id else []
        if len(entries) != 1:
            many = "more than one print begins with" if entries else "no print has"
            raise NoSuchPrint(
                f"{many} the id {print_id[:40]!r}; `printctl history` lists the ids, "
                "`printctl history rebuild FOLDER` finds prints that it doesn't know"
            )
        return entries[0]

    def known(
        self, column: Literal["profile", "who", "state"], within: tuple[Path, ...] = ()
    ) -> list[str]:
        """Return what there is in a column of prints below the folders, or of all, sorted."""
        where, values = below_any(within) if within else ("1", [])
        with self._errors_named():
            self._catch_up()
            with self._open() as index:
                rows = index.execute(
                    f"SELECT DISTINCT {COLUMN_OF[column]} FROM prints p WHERE {where} ORDER BY 1",
                    values,
                ).fetchall()
                return [str(value) for (value,) in rows if value]

    # --- the index -------------------------------------------------------------------------

    def _catch_up(self) -> None:
        """Read the journals that were begun or written to since they were read last."""
        with self._open() as index:
            seen = {path: tuple(stamp) for path, *stamp in index.execute("SELECT * FROM seen")}
            unfinished = index.execute(
                "SELECT journal FROM prints WHERE state = ?", (INTERRUPTED,)
            ).fetchall()
        last = [folder / JOURNAL for folder in known_folders(self.folder)]
        journals = dict.fromkeys([*last, *(Path(path) for (path,) in unfinished)])
        grown = [one for one in journals if _stamp(one) not in (_GONE, seen.get(str(one)))]
        folders = dict.fromkeys(journal.parent for journal in grown)
        if folders:
            self._take_in(j for folder in folders for j in journals_in(folder))

    def _take_in(self, journals: Iterable[Path]) -> None:
        entries = []
        for journal in journals:
            with contextlib.suppress(OSError):  # moved away since: the last known stays
                stamp = _stamp(journal)  # before it is read: what comes meanwhile is seen later
                entries.append((journal, entry_of(journal), stamp))
        with self._open() as index:
            for journal, entry, stamp in entries:
                if entry is not None:
                    write_entry(index, entry, stamp)
                else:
                    _note_seen(index, journal, stamp)

    def _prepare(self) -> None:
        with self._open() as index:
            version = index.execute("PRAGMA user_version").fetchone()[0]
            if version == 0:
                index.executescript(_TABLES)
            tables = {row[0] for row in index.execute("SELECT name FROM sqlite_master")}
            if version not in (0, _VERSION) or not {"prints", "alarms"} <= tables:
                raise sqlite3.DatabaseError(f"version {version} with tables {sorted(tables)}")
            if not {"seen", "operators"} <= tables:
                index.executescript(_HELPERS)

    @contextlib.contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """A connection for one transaction."""
        index = sqlite3.connect(self.path, timeout=_BUSY_LIMIT_S)
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

    @contextlib.contextmanager
    def _errors_named(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, OSError) as exc:
            raise HistoryError(
                f"the history in {self.folder} can't be used: {exc}; the journals are untouched; "
                "see to the folder (PRINTCTL_DATA moves it), then `printctl history rebuild`"
            ) from exc


def remember(print_folder: Path, data: Path | None = None) -> None:
    """Take a print into the history; what goes wrong is logged and disturbs nothing."""
    try:
        PrintHistory(data).note(print_folder)
    except Exception:
        log.exception("the print isn't in the history; `printctl history rebuild` will find it")


def remember_meanwhile(print_folder: Path) -> threading.Thread:
    """`remember` in a thread of its own, which doesn't keep the process alive."""
    given = print_folder, data_folder()
    thread = threading.Thread(target=remember, args=given, name="history", daemon=True)
    thread.start()
    return thread


def _stamp(journal: Path) -> tuple[int | None, int | None]:
    """Size and time of change; nothing for a journal that isn't there."""
    try:
        there = journal.stat()
    except OSError:
        return _GONE
    return there.st_size, there.st_mtime_ns


def _entries(index: sqlite3.Connection, rows: Sequence[tuple[object, ...]]) -> list[PrintEntry]:
    ids = json.dumps([row[_COLUMNS.index("id")] for row in rows])
    alarms: dict[object, list[Alarm]] = {}
    for print_id, at, text in index.execute(
        "SELECT id, at, text FROM alarms WHERE id IN (SELECT value FROM json_each(?)) ORDER BY n",
        (ids,),
    ):
        alarms.setdefault(print_id, []).append(Alarm(at, text))
    entries = []
    for row in rows:
        values: dict[str, Any] = dict(zip([*_COLUMNS, "operator"], row, strict=True))
        values["journal"] = Path(str(values["journal"]))
        entries.append(PrintEntry(**values, alarms=tuple(alarms.get(values["id"], ()))))
    return entries


def write_entry(
    index: sqlite3.Connection, entry: PrintEntry, stamp: tuple[int | None, int | None]
) -> None:
    """Write one print into an open index; ``stamp`` is its journal's size and time of change."""
    values = {name: getattr(entry, name) for name in _COLUMNS}
    values["journal"] = str(entry.journal.resolve())
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
    if entry.operator:
        index.execute("INSERT OR REPLACE INTO operators VALUES (?, ?)", (entry.id, entry.operator))
    _note_seen(index, entry.journal, stamp)


def _note_seen(
    index: sqlite3.Connection, journal: Path, stamp: tuple[int | None, int | None]
) -> None:
    seen = (str(journal.resolve()), *stamp)
    index.execute("INSERT OR REPLACE INTO seen VALUES (?, ?, ?)", seen)
