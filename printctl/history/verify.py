"""Verify a bundle's contents and signature without unpacking it."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import BinaryIO

from printctl.history.plain_zip import Member, blocks_of, read_members
from printctl.history.signing import (
    LARGEST,
    MANIFEST,
    PUBLIC_KEY,
    SIGNATURE,
    BundleError,
    Manifest,
    read_manifest,
)
from printctl.machine.records.lab_key import KeyTrouble, PublicKey, read_public, signing_missing
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.sealing import Finding, JournalCheck, check_journal

_SIGNATURE_BYTES = 64


class Signature(StrEnum):
    """What the signature says."""

    TRUSTED = "trusted"
    UNKNOWN = "unknown key"
    WRONG = "wrong"
    NONE = "unsigned"
    UNCHECKED = "unchecked"


@dataclass(frozen=True)
class BundleCheck:
    """Result of verifying a bundle.

    Attributes
    ----------
    changed : tuple of str
        What isn't as it was written; empty for a whole bundle.
    signature : Signature
    fingerprint : str
        Of the key that signed; empty where none did.
    manifest : Manifest or None
        As far as it could be read; to be believed only as far as the rest says.
    journal : JournalCheck or None
        What its journal proves to be; None where it can't be read.
    """

    changed: tuple[str, ...]
    signature: Signature = Signature.NONE
    fingerprint: str = ""
    manifest: Manifest | None = None
    journal: JournalCheck | None = None

    @property
    def whole(self) -> bool:
        """Whether every byte is as it was written."""
        return not self.changed

    @property
    def good(self) -> bool:
        """Whole and signed by a trusted key; since format 2 its journal at the print's end, too."""
        signed = self.whole and self.signature is Signature.TRUSTED
        if self.manifest is None or self.journal is None or self.manifest.format_version == 1:
            return signed and (self.journal is None or self.journal.finding is not Finding.CHANGED)
        return signed and self.journal.finding is Finding.SIGNED

    def lines(self) -> list[str]:
        """For people, the most important first."""
        if not self.whole:
            return ["CHANGED: this isn't what was filed", *(f"  {text}" for text in self.changed)]
        known = "it was filed" if self.signature is Signature.TRUSTED else "the bundle's list says"
        said = [f"WHOLE: every file is as {known}", _SAID[self.signature].format(self)]
        return said + ([f"JOURNAL: {self.journal.words}"] if self.journal else [])


_SAID = {
    Signature.TRUSTED: "SIGNED by the trusted key {0.fingerprint}",
    Signature.UNKNOWN: (
        "SIGNED BY A KEY THAT ISN'T KNOWN HERE: {0.fingerprint}\n"
        "  anybody can make a key: compare this fingerprint with the lab's, or give its key "
        "(--key)"
    ),
    Signature.WRONG: "THE SIGNATURE IS WRONG",
    Signature.NONE: (
        "UNSIGNED: whoever could write the file could have changed it and its hashes together"
    ),
    Signature.UNCHECKED: (
        "SIGNATURE NOT CHECKED: cryptography isn't installed; pip install 'printctl[records]'"
    ),
}


def verify_bundle(path: Path, trusted: Sequence[PublicKey]) -> BundleCheck:
    """Verify a file.

    Raises
    ------
    BundleError
        When it can't be read at all.
    """
    try:
        with path.open("rb") as stream:
            return verify_stream(stream, trusted)
    except OSError as exc:
        raise BundleError(f"{path} can't be read: {exc.strerror}; check the path") from exc


def verify_stream(stream: BinaryIO, trusted: Sequence[PublicKey]) -> BundleCheck:
    """Verify a bundle.

    Parameters
    ----------
    stream : binary stream
        Open for reading, can be sought in.
    trusted : sequence of PublicKey
        Keys that the reader knows to be the lab's.
    """
    try:
        members = {member.name: member for member in read_members(stream)}
        manifest_bytes = _small(stream, members, MANIFEST, LARGEST)
        manifest = read_manifest(manifest_bytes)
    except BundleError as exc:
        return BundleCheck((str(exc),))
    changed = [*_files(stream, members, manifest)]
    if members[MANIFEST].crc != zlib.crc32(manifest_bytes):
        changed.append(f"{MANIFEST}: it doesn't match its checksum")
    if manifest_bytes != manifest.to_bytes():
        changed.append(f"{MANIFEST}: not written as printctl writes it")
    signature, fingerprint = _signature(stream, members, manifest, manifest_bytes, trusted)
    if signature is Signature.WRONG:
        changed.append(f"{MANIFEST}: it isn't what was signed, or the signature was changed")
    journal = None
    if JOURNAL in members:
        data = b"".join(blocks_of(stream, members[JOURNAL]))
        journal = check_journal(data, trusted)
        if (
            manifest.journal and manifest.journal.finding is Finding.CHANGED
        ):  # by what was known there
            journal = JournalCheck(Finding.CHANGED, manifest.journal.words)
    return BundleCheck(tuple(changed), signature, fingerprint, manifest, journal)


def _files(stream: BinaryIO, members: dict[str, Member], manifest: Manifest) -> list[str]:
    """What is changed, missing or more than the manifest says."""
    wanted = {file.path: file for file in manifest.files}
    own = [MANIFEST, SIGNATURE] if SIGNATURE in members else [MANIFEST]
    problems = [f"{name}: not in the bundle any more" for name in sorted({*wanted} - {*members})]
    more = sorted({*members} - {*wanted, *own})
    problems += [f"{name}: put in afterwards" for name in more]
    if list(members) != [*sorted(wanted), *own] and not problems:
        problems.append("the files aren't in the order in which printctl writes them")
    for name in sorted({*wanted} & {*members}):
        digest, crc, size = hashlib.sha256(), 0, 0
        for block in blocks_of(stream, members[name]):
            digest.update(block)
            crc, size = zlib.crc32(block, crc), size + len(block)
        file, member = wanted[name], members[name]
        if (digest.hexdigest(), size) != (file.sha256, file.bytes) or crc != member.crc:
            problems.append(f"{name}: changed")
    return problems


def _signature(
    stream: BinaryIO,
    members: dict[str, Member],
    manifest: Manifest,
    data: bytes,
    trusted: Sequence[PublicKey],
) -> tuple[Signature, str]:
    if SIGNATURE not in members:
        return (Signature.WRONG if manifest.signed_by else Signature.NONE), ""
    if signing_missing() is not None:
        return Signature.UNCHECKED, ""
    try:
        signature = _small(stream, members, SIGNATURE, _SIGNATURE_BYTES)
        key = read_public(_small(stream, members, PUBLIC_KEY, 10_000), PUBLIC_KEY)
    except (BundleError, KeyTrouble):
        return Signature.WRONG, ""
    intact = members[SIGNATURE].crc == zlib.crc32(signature)
    signed = intact and key.signed(signature, data) and key.fingerprint == manifest.signed_by
    if not signed:
        return Signature.WRONG, ""
    known = any(key.raw == one.raw for one in trusted)
    return (Signature.TRUSTED if known else Signature.UNKNOWN), key.fingerprint


def _small(stream: BinaryIO, members: dict[str, Member], name: str, limit: int) -> bytes:
    if name not in members:
        raise BundleError(f"there is no {name} in it: this is no bundle of printctl's")
    if members[name].size > limit:
        raise BundleError(f"{name} has {members[name].size} bytes of {limit} allowed")
    return b"".join(blocks_of(stream, members[name]))
