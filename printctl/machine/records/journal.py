r"""Print journal: append-only file of all events of a print.

One record a line: ``<crc32 of the JSON, 8 hex digits> <JSON>\n``. A record is one ``write`` to a
file opened for appending, so a killed process leaves at most one torn line at the end, which the
reader drops and reports. Its last key, ``chain``, is the hash of all lines before it, whole or torn
(`link`, `shown`); the checksum shows a torn line by itself. Record sorts (key
``t``):

========== =====================================================================================
job        ``id`` of the print, file name, sha256, lines, profile, port, pid, who, host, wall-clock
           start: first; again on going on, with the same ``id`` and when the journal was written
           last (``heard``); ``accepted``: failed checks that the user told to print with all the
           same
state      state, message
ack        ``done``: command lines known to be taken; never more than is true; with ``at`` where
           the last that had one is a second old: the print's pace
back       ``done``, ``n``: lines that an ok which wasn't theirs had acknowledged are taken back, to
           the line of number ``n``; control records of what goes again follow
control    ``n``, ``command``: a line number about to be used for a control command
alarm      text
repeated   an alarm came again: ``first``: its first text, ``text``: its last, ``times``
checkpoint position read back (M114) after ``done`` command lines, ``agrees`` with the job's text?
           ``mark``: what ended there, where it was made at a mark; ``stands``: with the motors at
           rest, so that those lines were made
wanted     ``after``: the mark at which somebody wants the print held; empty once it is taken
           back; ``head``: of several, whose syringe
reload     a change of syringe begins after ``done`` lines; the plunger's count was ``e``; ``head``:
           of several, whose
syringe    ``n``, ``command``: the line about to call the new plunger's place the job's; what was
           put in; ``reload_at``, ``reload_heads``: where the next changes are due
left       the job's ``place`` that the needle leaves for a pause or a look: after the host's death
           it tells what the job's own lines haven't; ``park``: where it then waits, if not above
look       ``look``: the number of a look that begins after ``done`` lines; ``mark``, ``layer``
insert     ``look``, ``after``, ``lines``, ``sha256``, ``why``: lines that follow the first
           ``after`` of the job, earlier inserts counted; on the disk before the job has them;
           ``flow``: what the job's moves that write push behind them, over what the file says;
           ``reload_at``, ``reload_heads``: where the changes of syringe are due in the grown job
looked     ``look``, ``done``, ``decision``, ``why``, ``by``: a look was decided
firmware   ``capabilities``, by name, as the firmware has reported them (M115)
settings   ``told``: commands that set the firmware as it was before the job's first line, by code
frame      ``told``, ``offset``: how the printer's count lay before the job's first line
heat       ``targets``, °C by heater, as this print has set them after ``line`` lines of the job
host       ``do``: ``selected`` (file stored on a network host and compared), ``start`` (the command
           is about to leave), ``begun`` or ``not begun`` by the host's own record (``by``)
stood      after a stop: ``line``, ``begin_at``, ``certain`` as in `StopPlace`; ``done`` lines were
           taken; ``dropped``: whether moves weren't made; ``place`` that the printer told
end        state, message, done, error, position_known: last; where the printer refused a line of
           the job: ``refused``, the lines before it, and ``made``, those of them surely made;
           ``lost`` where records before it couldn't be written
action     ``do``: what a person, or a program of theirs, has requested of the print, ``who`` and
           ``from`` where: see `printctl.machine.records.actor`; ``given``: with which values
seal       signature of all lines before it, after the end: ``key``, ``signature``; or why there is
           none: ``unsigned``
========== =====================================================================================

job, state, alarm, checkpoint, left, wanted, reload, syringe, look, insert, looked, firmware, host,
stood, end, action and seal records also have ``at``, the wall-clock time, s since 1970.

What is durable: every record is in the kernel when `Journal.add` returns, so it survives the
death of the process (kill -9). The dated ones above are also forced to the disk, but for actions,
as a kill may come next on the same thread, and for a checkpoint that agrees and was made at no
mark. That one and ack and control records are not, since
forcing the disk several times a second would stall the line, and after a loss of power the printer
has lost its position as well.

Room is kept back on the disk (``journal.reserve``), so that the pause that a full disk makes can be
written down. Emptied, it says that records may be missing at the journal's end.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import secrets
import shutil
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Printer
from firmware_profiles.strict_model import Facts
from printctl.machine.errors import JournalError
from printctl.version import version

Record = dict[str, Any]
RESERVE: Final = "journal.reserve"
RESERVE_BYTES: Final = 65_536
_PACE_EVERY_S: Final = 1.0
_DATED: Final = frozenset(
    {"job", "state", "alarm", "checkpoint", "left", "wanted", "reload", "syringe", "stood", "end"}
    | {"look", "insert", "looked", "firmware", "host", "action", "asked"}
)
BEGIN: Final = bytes(32)
"""The chain's hash before the first line."""
_UNFORCED: Final = frozenset({"action", "asked"})
_ENCODER: Final = json.JSONEncoder(separators=(",", ":"))
Sign = Callable[[Record, bytes, bytes], Record]
"""Return a seal record completed; given the chain's hash before it and that of the first line."""


class Journal:
    """An append-only journal; any thread may add to it.

    An existing one is gone on with (a torn tail is closed by a line end). With ``reserve`` room is
    kept back on the disk until the print has ended. With ``sign`` it is sealed at the print's end.
    Raises `JournalError` when it can't be written.
    """

    def __init__(self, path: Path, reserve: bool = False, sign: Sign | None = None) -> None:
        self.path, self._sign = path, sign
        self._lock, self._ended = threading.Lock(), False
        self._over, self._sealed = False, False
        self._head, self._first, self._part = BEGIN, BEGIN, b""
        self._last_pace = 0.0
        self._reserve = path.with_name(RESERVE) if reserve else None
        try:
            if self._reserve is not None and bytes_in(self._reserve) < RESERVE_BYTES:
                self._reserve.write_bytes(os.urandom(RESERVE_BYTES))  # no disk can make it smaller
            self._fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
            if os.fstat(self._fd).st_size:
                self._took(path.read_bytes())
                if self._part:
                    self._took(b"\n"[: os.write(self._fd, b"\n")])
        except OSError as exc:
            raise JournalError(f"journal {path} can't be opened: {exc.strerror}") from exc

    def add(self, sort: str, **values: Any) -> None:
        """Append a record; raise `JournalError` when it can't be written (disk full).

        The record isn't there then.
        """
        dated, now = sort in _DATED, time.time()
        paced = sort == "ack" and now - self._last_pace >= _PACE_EVERY_S
        self._last_pace = now if paced else self._last_pace
        record = {"t": sort, **({"at": now} if dated or paced else {}), **values}
        passing = sort == "checkpoint" and values.get("agrees") and not values.get("mark")
        with self._lock:
            self._append(record, sync=dated and not passing and sort not in _UNFORCED)
            self._ended = sort == "end"
            if self._ended:
                self._over = True
                self._seal()

    def _append(self, record: Record, sync: bool, sign: Sign | None = None) -> None:
        head = link(self._head, self._part) if self._part else self._head
        record["chain"] = shown(head)
        if sign is not None:
            record = sign(record, head, self._first)
        line = encode(record)
        if self._part:  # a part of the last record is there
            line = b"\n" + line
        try:
            written = os.write(self._fd, line)
            self._took(line[:written])
            if written != len(line):
                raise OSError("disk full")
            if sync:
                os.fsync(self._fd)
        except OSError as exc:
            raise JournalError(
                f"journal {self.path} can't be written: {exc}; free space on the disk"
            ) from exc

    def _took(self, data: bytes) -> None:
        """Count what was written in the chain."""
        *lines, self._part = (self._part + data).split(b"\n")
        for line in lines:
            first, self._head = self._head is BEGIN, link(self._head, line)
            self._first = self._head if first else self._first
        self._sealed = False

    def _seal(self) -> None:
        """Sign what is there; where the disk has no room, the end is there without."""
        if self._sign is not None:
            with contextlib.suppress(JournalError):
                self._append({"t": "seal", "at": time.time()}, sync=True, sign=self._sign)
                self._sealed = True

    def use_reserve(self) -> bool:
        """Free the room kept back, so that the record that didn't fit may be added once more.

        False where there is none left.
        """
        with self._lock:
            if self._reserve is None or not bytes_in(self._reserve):
                return False
            try:
                os.truncate(self._reserve, 0)
                if self._part:
                    os.ftruncate(self._fd, self.path.read_bytes().rfind(b"\n") + 1)
            except OSError:
                return False
            self._part = b""
            return True

    def keep_reserve(self) -> bool:
        """Keep room back again after `use_reserve`; False where the disk hasn't as much yet."""
        with self._lock:
            if self._reserve is None:
                return True
            try:
                handle = os.open(self._reserve, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            except OSError:
                return False
            try:
                if os.write(handle, os.urandom(RESERVE_BYTES)) == RESERVE_BYTES:
                    return True
                os.ftruncate(handle, 0)
            except OSError:
                with contextlib.suppress(OSError):
                    os.ftruncate(handle, 0)
            finally:
                os.close(handle)
            return False

    def free_bytes(self) -> int:
        """Return the room on the journal's disk."""
        return shutil.disk_usage(self.path.parent).free

    def close(self) -> None:
        """Force everything to the disk, if it can, and let go of the file.

        Closing twice does no harm. The print is over: what the disk says now changes no outcome.
        """
        with self._lock:
            if self._fd >= 0:
                if self._over and not self._sealed:  # an alarm came after the end
                    self._seal()
                with contextlib.suppress(OSError):
                    os.fsync(self._fd)
                with contextlib.suppress(OSError):
                    os.close(self._fd)
                self._fd = -1
            if self._ended and self._reserve is not None:
                with contextlib.suppress(OSError):
                    self._reserve.unlink(missing_ok=True)


def bytes_in(path: Path) -> int:
    """Size of a file; 0 where there is none."""
    try:
        return path.stat().st_size
    except OSError:
        return 0


def link(head: bytes, line: bytes) -> bytes:
    """Return the chain's hash after a line: SHA-256 of the one before and its bytes, no line end.

    Torn lines count as they are.
    """
    return hashlib.sha256(head + line).digest()


def shown(head: bytes) -> str:
    """Return what a line holds of the hash before it: 64 bits tell where a change begins.

    A signature is of all 256.
    """
    return head[:8].hex()


def encode(record: Record) -> bytes:
    """One record as a line."""
    text = _ENCODER.encode(record).encode()
    return b"%08x %b\n" % (zlib.crc32(text), text)


def decode(line: bytes, chained: bool = False) -> Record | None:
    """Read a line; None when its checksum is wrong. With ``chained`` its chain's hash stays."""
    crc, _, text = line.rstrip(b"\n").partition(b" ")
    try:
        record = json.loads(text.decode()) if crc == b"%08x" % zlib.crc32(text) else None
    except (ValueError, RecursionError):
        return None
    if not isinstance(record, dict):
        return None
    if not chained:
        record.pop("chain", None)
    return record


def read_records(path: Path) -> Iterator[Record | None]:
    """Give the records in order, None for each damaged line."""
    with path.open("rb") as handle:
        for line in handle:
            yield decode(line) if line.endswith(b"\n") else None


def new_print_id(started: float) -> str:
    """Return a random identity for a print begun at ``started`` (s since 1970), sorting by it."""
    return f"{int(started):010d}-{secrets.token_hex(4)}"


def print_id(job: Record) -> str:
    """Return the identity of the print that a journal's first job record begins.

    Journals of versions without identities have one of what that record says.
    """
    if job.get("id"):
        return str(job["id"])
    words = "|".join(str(job.get(key)) for key in ("started", "pid", "host", "sha256", "path"))
    return f"{int(job.get('started', 0)):010d}-{zlib.crc32(words.encode()):08x}"


def origin(printer: Printer) -> dict[str, Any]:
    """Return program version and profile: ``printctl``, ``profile_sha256``, ``printer``."""
    return {
        "printctl": version(),
        "profile_sha256": profile_digest(printer),
        "printer": printer.model_dump(mode="json"),
    }


def profile_digest(profile: Facts) -> str:
    """SHA-256 of a profile's values, whatever the order and comments of its file, hex."""
    return digest_of(profile.model_dump(mode="json"))


def digest_of(values: Any) -> str:
    """SHA-256 of values as JSON, independent of the keys' order, hex."""
    text = json.dumps(values, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
