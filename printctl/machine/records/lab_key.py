"""Signing key of this machine's records: create, store and load it; sign and verify."""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printctl.errors import PrintctlError
from printctl.machine.records.folders import data_folder

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey


class RecordsError(PrintctlError):
    """Base of what goes wrong with records."""


class KeyTrouble(RecordsError):  # noqa: N818 (named after what is wrong)
    """A key that can't be used."""


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
