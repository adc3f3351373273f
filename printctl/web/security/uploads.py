"""Receive uploaded files: streamed to disk, size-limited, under safe names.

A file is written beside its place under a temporary name and renamed when it is whole and of a
kind that is wanted; what is refused leaves nothing behind. Nothing here is run or unpacked.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.security.file_types import HEAD_BYTES, Kind, kind_of
from printctl.web.workspace import checked_name

_PIECE: Final = 1 << 20


@dataclass(frozen=True)
class UploadLimits:
    """Limits of an upload.

    Attributes
    ----------
    bytes : int
        Largest file.
    kinds : frozenset of Kind
        By content; empty for any.
    suffixes : tuple of str
        Lower case, with the dot; empty for any.
    replace : bool
        Whether a file of that name may be replaced.
    """

    bytes: int
    kinds: frozenset[Kind] = frozenset()
    suffixes: tuple[str, ...] = ()
    replace: bool = False


class TooLargeUploadError(BadRequestError):
    """More than may be sent."""

    status = 413


def save_upload(
    stream: IO[bytes] | Iterable[bytes], folder: Path, name: str, limits: UploadLimits
) -> Path:
    """Write what ``stream`` gives to ``folder / name``.

    Returns
    -------
    Path
        The file, whole.

    Raises
    ------
    BadRequestError
        For a name, kind or size that isn't taken.
    ConflictError
        When there is such a file, and it may not be replaced.
    """
    with _receiving(folder, name, limits) as receiving:
        for piece in _pieces(stream):
            receiving.take(piece)
        return receiving.finish()


class _Receiving:
    """One file on its way in."""

    def __init__(self, file: IO[bytes], part: Path, place: Path, limits: UploadLimits) -> None:
        self._file, self._part, self._place, self._limits = file, part, place, limits
        self._got, self._head = 0, b""

    def take(self, piece: bytes) -> None:
        """Write a piece of it."""
        self._got += len(piece)
        if self._got > self._limits.bytes:
            raise TooLargeUploadError(
                f"{self._place.name} is larger than {self._limits.bytes / 1e6:g} MB, the most that "
                "is taken here; `printctl serve --upload-mb` sets it"
            )
        if len(self._head) < HEAD_BYTES:
            self._head += piece[: HEAD_BYTES - len(self._head)]
        self._file.write(piece)

    def finish(self) -> Path:
        """Look at its kind, and give it its name."""
        if not self._got:
            raise BadRequestError(f"{self._place.name} is empty")
        kind = kind_of(self._head)
        if self._limits.kinds and kind not in self._limits.kinds:
            wanted = ", ".join(sorted(self._limits.kinds))
            raise BadRequestError(
                f"{self._place.name} is {kind} by its content; what is taken here: {wanted}"
            )
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        if self._limits.replace:
            self._part.replace(self._place)
            return self._place
        try:
            os.link(self._part, self._place)  # fails where another was faster, unlike a rename
        except FileExistsError as exc:
            raise _there_is(self._place) from exc
        except OSError:  # a disk without links
            self._part.rename(self._place)
        return self._place


@contextmanager
def _receiving(folder: Path, name: str, limits: UploadLimits) -> Iterator[_Receiving]:
    place = folder / checked_name(name)
    if limits.suffixes and not name.lower().endswith(limits.suffixes):
        raise BadRequestError(f"{name} must end with one of: {', '.join(limits.suffixes)}")
    if place.exists() and not limits.replace:
        raise _there_is(place)
    folder.mkdir(parents=True, exist_ok=True)
    part = folder / f".{secrets.token_hex(8)}.part"
    try:
        with part.open("xb") as file:
            yield _Receiving(file, part, place, limits)
    finally:
        part.unlink(missing_ok=True)


def _there_is(place: Path) -> ConflictError:
    return ConflictError(f"there is a file {place.name} already; send it under another name")


def _pieces(stream: IO[bytes] | Iterable[bytes]) -> Iterator[bytes]:
    if hasattr(stream, "read"):
        while piece := stream.read(_PIECE):
            yield piece
    else:
        yield from stream
