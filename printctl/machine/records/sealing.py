"""Sign a journal at its print's end, and find out what was changed in one."""

from __future__ import annotations

import contextlib
import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

from printctl.machine.records.folders import data_folder
from printctl.machine.records.journal import BEGIN, Record, decode, encode, link, shown
from printctl.machine.records.lab_key import (
    KeyTrouble,
    PublicKey,
    RecordsError,
    lab_key,
    signing_missing,
)

_SIGNED_HERE: Final = "seals.txt"
"""Beside the key: for each signature the chain's hash after the first line, and before the seal."""
log = logging.getLogger(__name__)


def sign_journal(record: Record, head: bytes, first: bytes) -> Record:
    """Complete a seal record, as a `Journal` wants it; without a key it says why there is none."""
    try:
        key = lab_key()
        record |= {"key": key.public.raw.hex()}
        record |= {"signature": key.sign(_message(record, head)).hex()}
    except KeyTrouble as exc:
        return {**record, "unsigned": str(exc)}
    except Exception as exc:  # whatever ails the library: the print's end is written down
        log.exception("the journal can't be signed")
        return {**record, "unsigned": repr(exc)}
    with contextlib.suppress(OSError), (data_folder() / _SIGNED_HERE).open("a") as handle:
        handle.write(f"{first.hex()} {head.hex()}\n")
    return record


def _message(record: Record, head: bytes) -> bytes:
    return b"printctl journal %b " % head.hex().encode() + json.dumps(record).encode()


class Finding(StrEnum):
    """What a journal proves to be."""

    SIGNED = "signed"
    UNKNOWN_KEY = "unknown key"
    UNSIGNED = "not signed"
    UNCHAINED = "not chained"
    CHANGED = "changed"
    UNCHECKED = "unchecked"


@dataclass(frozen=True)
class JournalCheck:
    """Result of verifying a journal.

    Attributes
    ----------
    finding : Finding
    words : str
        The same for people, with the line.
    fingerprint : str
        Of the key that signed last; empty where none did.
    """

    finding: Finding
    words: str
    fingerprint: str = ""


@dataclass(frozen=True)
class _Seal:
    line: int
    head: bytes
    record: Record
    raw: bytes

    def right(self) -> bool:
        """Whether it is this chain's; KeyTrouble without the library."""
        unsigned = dict(self.record)
        try:
            signature, key = bytes.fromhex(unsigned.pop("signature")), self.key
        except (KeyError, TypeError, ValueError):
            return False
        exact = self.raw + b"\n" == encode({**unsigned, "signature": signature.hex()})
        return exact and len(key.raw) == 32 and key.signed(signature, _message(unsigned, self.head))

    @property
    def key(self) -> PublicKey:
        return PublicKey(bytes.fromhex(self.record["key"]))


def check_journal(
    data: bytes, trusted: Sequence[PublicKey], signed_here: bool = False
) -> JournalCheck:
    """Verify a journal's chain and its last signature.

    Parameters
    ----------
    data : bytes
        The file.
    trusted : sequence of PublicKey
        Keys that the reader knows to be the lab's.
    signed_here : bool
        Whether it must have the last signature that this machine has given it: of a journal in
        its folder, not of one that was filed before its print was continued.
    """
    *lines, tail = data.split(b"\n")
    head, first, chained, torn, old = BEGIN, BEGIN, False, 0, 0
    seals: list[_Seal] = []
    ended = False
    for number, raw in enumerate(lines, 1):
        record = decode(raw, chained=True)
        if record is None:
            torn += 1
        elif "chain" in record or chained:
            if record.get("chain") != shown(head):
                return _changed(f"after line {max(number - 2, 0)}: line {number} doesn't follow")
            chained = True
        else:
            old += 1
        if record is not None and record.get("t") == "seal":
            seals.append(_Seal(number, head, record, raw))
        elif record is not None:
            ended = record.get("t") == "end" or (ended and record.get("t") == "alarm")
        head = link(head, raw)
        first = head if number == 1 else first
    given = [one for one in seals if "signature" in one.record]
    if given and (missing := signing_missing()):
        return JournalCheck(Finding.UNCHECKED, f"signature not checked: {missing}")
    for seal in given:
        if not seal.right():
            return _changed(f"before line {seal.line}: it isn't what was signed there")
    if signed_here and (missing := _missing_seal(first, given)):
        return _changed(missing)
    if lines and torn == len(lines):
        words = "the journal was changed: no line has its checksum, as after a change of line ends "
        return JournalCheck(Finding.CHANGED, words + "or encoding (an editor, git)")
    if not chained:
        words = "not chained: written by a version of printctl without a chain of lines, or the "
        words += "chain was taken out"
        return JournalCheck(Finding.UNCHAINED, words if lines else "empty: there is no line in it")
    if tail or not given or given[-1].line != len(lines):
        words = _unsigned_words(seals, given, len(lines) + bool(tail), ended)
        return JournalCheck(Finding.UNSIGNED, words)
    key = given[-1].key
    words = f"{len(lines)} lines, chained and signed at the print's end"
    words += f"; the first {old} are of a version without a chain" if old else ""
    words += f"; {torn} torn, as a loss of power leaves them" if torn else ""
    finding, by = Finding.UNKNOWN_KEY, "BY A KEY THAT ISN'T KNOWN HERE:"
    if any(key.raw == one.raw for one in trusted):
        finding, by = Finding.SIGNED, "by the trusted key"
    return JournalCheck(finding, f"{words} {by} {key.fingerprint}", key.fingerprint)


def check_journal_file(path: Path, trusted: Sequence[PublicKey]) -> JournalCheck:
    """Verify a journal in its print's folder; RecordsError when it can't be read."""
    try:
        if not path.is_file():  # a device has no end
            raise RecordsError(f"{path} isn't a regular file; give a run, a print or its journal")
        return check_journal(path.read_bytes(), trusted, signed_here=True)
    except OSError as exc:
        raise RecordsError(f"{path} can't be read: {exc.strerror}; check the path") from exc


def _changed(where: str) -> JournalCheck:
    return JournalCheck(Finding.CHANGED, f"the journal was changed {where}")


def _missing_seal(first: bytes, given: Sequence[_Seal]) -> str:
    """Say that the last signature given here isn't in a journal any more; empty where it is."""
    try:
        pairs = [line.split() for line in (data_folder() / _SIGNED_HERE).read_text().splitlines()]
    except OSError:
        return ""
    heads = [pair[1] for pair in pairs if len(pair) == 2 and pair[0] == first.hex()]
    if not heads or heads[-1] in (one.head.hex() for one in given):
        return ""
    after = given[-1].line if given else 0
    return f"after line {after}: this machine has signed it with other lines there"


def _unsigned_words(seals: Sequence[_Seal], given: Sequence[_Seal], count: int, ended: bool) -> str:
    if seals and seals[-1].line == count and "unsigned" in seals[-1].record:
        return f"not signed: {seals[-1].record['unsigned']}"
    if given:
        more, last = count - given[-1].line, given[-1].line
        follow = "1 line follows" if more == 1 else f"{more} lines follow"
        return f"not signed: {follow} the last signature, which is line {last}"
    if ended:
        return "not signed: the print ended without a signature"
    return (
        "not signed: the print ended without a last line in its journal (loss of power, or its "
        "process was killed), or it is still going on"
    )
