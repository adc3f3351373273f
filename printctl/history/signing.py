"""Manifest of a record bundle: the print, its files with their digests, and the signer."""

from __future__ import annotations

import json
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from firmware_profiles.errors import wording
from printctl.machine.records.lab_key import RecordsError
from printctl.machine.records.sealing import Finding


class BundleError(RecordsError):
    """No bundle, or none that can be made."""


MANIFEST, SIGNATURE, PUBLIC_KEY = "manifest.json", "manifest.sig", "public_key.pem"
LARGEST = 4 * 2**20
"""Bytes of a manifest."""
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Text = Annotated[str, Field(max_length=4000)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FileEntry(_Part):
    """One file of the bundle."""

    path: Annotated[str, Field(max_length=255)]
    what: Text
    sha256: Digest
    bytes: Annotated[int, Field(ge=0)]


class FiledAlarm(_Part):
    """One alarm; time in s since 1970."""

    at: float
    text: Text


class FiledPrint(_Part):
    """The print as its journal tells it; times in s since 1970."""

    id: Text
    file: Text
    sha256: Text
    profile: Text
    port: Text
    operator: Text = ""
    who: Text
    host: Text
    started: float
    ended: float
    state: Text
    message: Text
    error: Text
    done: int
    total: int
    begun: int
    alarms: tuple[FiledAlarm, ...]


class FiledJournal(_Part):
    """What the journal proved to be when it was packed."""

    finding: Finding
    words: Text


class Manifest(_Part):
    """Signed contents list of a bundle.

    ``hashes`` are the SHA-256 of what the print was made of and by, in the bundle or not; they and
    ``journal`` are None in format version 1.
    """

    format: Literal["printctl print record"] = "printctl print record"
    format_version: Literal[1, 2] = 2
    print: FiledPrint
    verdict: Text
    versions: dict[str, Text]
    missing: tuple[Text, ...]
    journal: FiledJournal | None = None
    hashes: dict[str, Digest] | None = None
    files: tuple[FileEntry, ...]
    signed_by: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")] = ""

    def to_bytes(self) -> bytes:
        """As it is written and signed; the same content gives the same bytes."""
        text = json.dumps(
            self.model_dump(mode="json", exclude_none=True),
            indent=1,
            sort_keys=True,
            allow_nan=False,
        )
        return text.encode() + b"\n"


def read_manifest(data: bytes) -> Manifest:
    """Read what `Manifest.to_bytes` wrote.

    Raises
    ------
    BundleError
    """
    try:
        return Manifest.model_validate_json(data)
    except ValidationError as exc:
        first = exc.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise BundleError(f"{MANIFEST} can't be read: {where}: {wording(first)}") from exc
