"""Signing key, signature and manifest of a record bundle, and its exceptions."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from firmware_profiles.errors import wording
from printctl.errors import PrintctlError
from printctl.machine.records.folders import data_folder

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey


class RecordsError(PrintctlError):
    """Base of what goes wrong with records."""


class BundleError(RecordsError):
    """No bundle, or none that can be made."""


class KeyTrouble(RecordsError):  # noqa: N818 (named after what is wrong)
    """A key that can't be used."""


# Create, store and load the lab's private signing key; sign, and verify by public key.
#
# Ed25519 (RFC 8032): the same text signed twice gives the same signature. The library comes with
# the extra ``records`` (and with ``search``).
PRIVATE: Final = "records_key.pem"
_LARGEST: Final = 10_000
"""Bytes of a key's file: an Ed25519 key takes some hundred."""


@dataclass(frozen=True)
class PublicKey:
    """Who can be told by a signature.

    Attributes
    ----------
    raw : bytes
        The 32 of RFC 8032.
    """

    raw: bytes

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the key, 64 hex digits: to be compared by telephone or on paper."""
        return hashlib.sha256(self.raw).hexdigest()

    def pem(self) -> bytes:
        """As a PEM file (SubjectPublicKeyInfo), which openssl reads, too."""
        _, ed25519, serialization = _library()
        key = ed25519.Ed25519PublicKey.from_public_bytes(self.raw)
        pem: bytes = key.public_bytes(
            serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
        )
        return pem

    def signed(self, signature: bytes, data: bytes) -> bool:
        """Whether the signature is this key's on the data."""
        exceptions, ed25519, _ = _library()
        try:
            ed25519.Ed25519PublicKey.from_public_bytes(self.raw).verify(signature, data)
        except exceptions.InvalidSignature:
            return False
        return True


@dataclass(frozen=True)
class LabKey:
    """What signs.

    Attributes
    ----------
    public : PublicKey
    """

    public: PublicKey
    _private: Ed25519PrivateKey

    def sign(self, data: bytes) -> bytes:
        """64 bytes."""
        signature: bytes = self._private.sign(data)
        return signature


def signing_missing() -> str | None:
    """What to do where the library isn't installed; None where it is."""
    try:
        import cryptography  # noqa: F401 (an extra)
    except ImportError:
        return (
            "signatures need cryptography, which isn't installed; run: "
            "pip install 'printctl[records]'"
        )
    return None


def lab_key(folder: Path | None = None) -> LabKey:
    """Read the lab's key; make it if there is none.

    Parameters
    ----------
    folder : Path, optional
        `data_folder` by default.

    Raises
    ------
    KeyTrouble
        When others may read the file, it holds no Ed25519 key, or it can't be read or made.
    """
    path = (folder or data_folder()) / PRIVATE
    _, ed25519, serialization = _library()
    try:
        if not path.exists():
            _make(path)
        _refuse_open(path)
        key = serialization.load_pem_private_key(_small(path), password=None)
    except (OSError, ValueError, TypeError) as exc:
        raise KeyTrouble(f"the lab's key {path} can't be used: {exc}") from exc
    if not isinstance(key, ed25519.Ed25519PrivateKey):
        raise KeyTrouble(f"{path} holds no Ed25519 key; move it away and a new one is made")
    return LabKey(PublicKey(key.public_key().public_bytes_raw()), key)


def known_lab_key() -> PublicKey | None:
    """The lab's public key, if there is one on this machine."""
    path = data_folder() / PRIVATE
    return lab_key(path.parent).public if path.is_file() and signing_missing() is None else None


def read_public(pem: bytes, where: str) -> PublicKey:
    """Read a public key's PEM.

    Raises
    ------
    KeyTrouble
    """
    _, ed25519, serialization = _library()
    try:
        key = serialization.load_pem_public_key(pem[:_LARGEST])
    except Exception as exc:  # the library raises several kinds on garbage
        raise KeyTrouble(f"{where} holds no public key in PEM form: {exc}") from exc
    if not isinstance(key, ed25519.Ed25519PublicKey):
        raise KeyTrouble(f"{where} holds another kind of key than Ed25519")
    return PublicKey(key.public_bytes_raw())


def read_public_file(path: Path) -> PublicKey:
    """Read a public key that the user named.

    Raises
    ------
    KeyTrouble
    """
    try:
        return read_public(_small(path), str(path))
    except OSError as exc:
        raise KeyTrouble(f"key {path} can't be read: {exc.strerror}; check the path") from exc


def _make(path: Path) -> None:
    """Write a new key; where two processes do so at once, the first one's counts."""
    _, ed25519, serialization = _library()
    pem = ed25519.Ed25519PrivateKey.generate().private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    path.parent.mkdir(0o700, parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    draft.unlink(missing_ok=True)
    try:
        with open(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as handle:
            handle.write(pem)
            handle.flush()
            os.fsync(handle.fileno())
        with contextlib.suppress(FileExistsError):
            os.link(draft, path)  # unlike a rename it replaces nothing
    finally:
        draft.unlink(missing_ok=True)


def _refuse_open(path: Path) -> None:
    mode = stat.S_IMODE(path.stat().st_mode)
    if os.name == "posix" and mode & 0o077:
        raise KeyTrouble(
            f"the lab's key {path} can be read by others (mode {mode:o}); if nobody else had it, "
            f"`chmod 600 {path}`; else move it away, and a new one is made"
        )


def _small(path: Path) -> bytes:
    with path.open("rb") as handle:
        return handle.read(_LARGEST)


def _library() -> tuple[Any, Any, Any]:
    missing = signing_missing()
    if missing is not None:
        raise KeyTrouble(missing)
    from cryptography import exceptions  # an extra
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ed25519

    return exceptions, ed25519, serialization


# Manifest of a record bundle: the print, its files with their digests, and the signer.
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


class Manifest(_Part):
    """Signed contents list of a bundle."""

    format: Literal["printctl print record"] = "printctl print record"
    format_version: Literal[1] = 1
    print: FiledPrint
    verdict: Text
    versions: dict[str, Text]
    missing: tuple[Text, ...]
    files: tuple[FileEntry, ...]
    signed_by: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")] = ""

    def to_bytes(self) -> bytes:
        """As it is written and signed; the same content gives the same bytes."""
        text = json.dumps(self.model_dump(mode="json"), indent=1, sort_keys=True, allow_nan=False)
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
