"""Write and read reproducible zip files: uncompressed, no timestamps, one fixed layout.

Any unzip program opens it. What is read must be laid out exactly so, byte for byte, headers
included; therefore no changed byte can hide between the files, and no small file can unpack into
a large one. Layout: PKWARE's APPNOTE 6.3.10, sections 4.3.7, 4.3.12 and 4.3.16.
"""

from __future__ import annotations

import hashlib
import re
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import BinaryIO, Final

from printctl.history.signing import BundleError

LARGEST: Final = 2**31 - 1
"""Bytes of a whole bundle: what every unzip program can read."""
MOST_FILES: Final = 10_000
_LOCAL: Final = struct.Struct("<4s5H3L2H")
_CENTRAL: Final = struct.Struct("<4s6H3L5H2L")
_END: Final = struct.Struct("<4s4H2LH")
_MADE_BY, _NEEDS, _DAY = 0x0314, 20, 0x21
"""Version 2.0 on Unix; 1980-01-01, the first day that a zip can name."""
_MODE: Final = 0o100644 << 16
_BLOCK: Final = 1 << 20
_PART: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,127}")


@dataclass(frozen=True)
class Member:
    """One file in it.

    Attributes
    ----------
    name : str
        With ``/`` between folders; see `safe_name`.
    size : int
        Bytes.
    crc : int
    start : int
        Of its local header in the zip.
    """

    name: str
    size: int
    crc: int
    start: int

    @property
    def data_start(self) -> int:
        """Where its bytes begin."""
        return self.start + _LOCAL.size + len(self.name)

    def local(self) -> bytes:
        """The header before its bytes."""
        fields = (_NEEDS, 0, 0, 0, _DAY, self.crc, self.size, self.size, len(self.name), 0)
        return _LOCAL.pack(b"PK\x03\x04", *fields) + self.name.encode("ascii")

    def central(self) -> bytes:
        """Its line in the directory."""
        sizes = (self.crc, self.size, self.size, len(self.name), 0, 0, 0, 0, _MODE, self.start)
        fields = (_MADE_BY, _NEEDS, 0, 0, 0, _DAY, *sizes)
        return _CENTRAL.pack(b"PK\x01\x02", *fields) + self.name.encode("ascii")


def safe_name(name: str) -> bool:
    """Whether a name stays in its folder on every system: parts of letters, digits, ``._-``."""
    parts = name.split("/")
    return len(name) <= 255 and all(
        _PART.fullmatch(part) and not part.endswith(".") and ".." not in part for part in parts
    )


class PlainZipWriter:
    """Writes files one after another to a stream that can be sought in.

    Raises
    ------
    BundleError
        For a name that isn't safe or comes twice, and beyond `LARGEST`; in all methods.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self.stream, self.members = stream, list[Member]()

    def add(self, name: str, blocks: Iterator[bytes]) -> tuple[Member, str]:
        """Copy a file in; give its place and its SHA-256, hex."""
        if not safe_name(name) or any(name == member.name for member in self.members):
            raise BundleError(f"name {name[:80]!r} can't stand in a bundle")
        start, digest, crc, size = self.stream.tell(), hashlib.sha256(), 0, 0
        self.stream.write(Member(name, 0, 0, start).local())
        for block in blocks:
            digest.update(block)
            crc, size = zlib.crc32(block, crc), size + len(block)
            if start + size > LARGEST - 2**20:
                raise BundleError(
                    f"the bundle would be larger than {LARGEST / 2**30:.0f} GB ({name}); "
                    "move large pictures out of the print's folder and file them apart"
                )
            self.stream.write(block)
        member = Member(name, size, crc, start)
        self.stream.seek(start)
        self.stream.write(member.local())
        self.stream.seek(0, 2)
        self.members.append(member)
        return member, digest.hexdigest()

    def close(self) -> None:
        """Write the directory."""
        self.stream.write(_tail(self.members, self.stream.tell()))


def read_members(stream: BinaryIO) -> list[Member]:
    """Walk through a zip and hold every header against what `PlainZipWriter` would write.

    Contents are not looked at: whoever reads them compares their digests.

    Raises
    ------
    BundleError
        When a byte outside the files' contents is other than it must be; says where.
    """
    length = stream.seek(0, 2)
    if length > LARGEST:
        raise BundleError(f"{length} bytes are more than a bundle can have ({LARGEST})")
    stream.seek(0)
    members: list[Member] = []
    place = 0
    while (member := _local_at(stream, place)) is not None:
        if member.data_start + member.size > length or len(members) >= MOST_FILES:
            raise BundleError(f"it is cut short, or {member.name!r} claims more than there is")
        members.append(member)
        place = member.data_start + member.size
    stream.seek(place)
    tail = _tail(members, place)
    if length - place != len(tail) or stream.read(len(tail)) != tail:
        raise BundleError(
            f"its directory, from byte {place} on, isn't as printctl writes it: it was cut "
            "short, changed, or packed anew by another program"
        )
    if len({member.name for member in members}) != len(members):
        raise BundleError("a name stands in it twice")
    return members


def blocks_of(stream: BinaryIO, member: Member) -> Iterator[bytes]:
    """A file's bytes, piece by piece."""
    left = member.size
    stream.seek(member.data_start)
    while left and (block := stream.read(min(left, _BLOCK))):
        left -= len(block)
        yield block


def _local_at(stream: BinaryIO, place: int) -> Member | None:
    """The file that begins there; None where the directory does."""
    stream.seek(place)
    head = stream.read(_LOCAL.size)
    if head[:4] in (b"PK\x01\x02", b"PK\x05\x06"):
        return None
    if len(head) < _LOCAL.size or head[:4] != b"PK\x03\x04":
        raise BundleError(f"byte {place} isn't the beginning of a file in a bundle")
    fields = _LOCAL.unpack(head)
    name = stream.read(min(fields[9], 256)).decode("ascii", "replace")
    if not safe_name(name):
        raise BundleError(f"name {name[:80]!r} can't stand in a bundle")
    if fields[3]:
        raise BundleError(f"{name} is compressed, which no file of a bundle is; not unpacked")
    member = Member(name, fields[8], fields[6], place)
    if head + name.encode("ascii") != member.local():
        raise BundleError(f"the header of {name} isn't as printctl writes it")
    return member


def _tail(members: Sequence[Member], place: int) -> bytes:
    lines = b"".join(member.central() for member in members)
    count = len(members)
    return lines + _END.pack(b"PK\x05\x06", 0, 0, count, count, len(lines), place, 0)
