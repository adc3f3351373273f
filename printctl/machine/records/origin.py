"""Record of program version and printer profile at a print's start."""

from __future__ import annotations

import hashlib
import json
from importlib import metadata
from typing import Any

from firmware_profiles import Printer
from firmware_profiles.strict_model import Facts


def origin(printer: Printer) -> dict[str, Any]:
    """For the journal's job record: ``printctl``, ``profile_sha256``, ``printer``."""
    return {
        "printctl": version(),
        "profile_sha256": profile_digest(printer),
        "printer": printer.model_dump(mode="json"),
    }


def version() -> str:
    """Of this program."""
    return metadata.version("printctl")


def profile_digest(profile: Facts) -> str:
    """SHA-256 of a profile's values, whatever the order and comments of its file, hex."""
    return digest_of(profile.model_dump(mode="json"))


def digest_of(values: Any) -> str:
    """SHA-256 of values as JSON, independent of the keys' order, hex."""
    text = json.dumps(values, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
