"""Manifest of a run folder: inputs, outputs, hashes and duration of each stage.

A stage is reused when its key (recipe sections, seeds, upstream files, product sources) and the
digests of its outputs are as they were. The manifest is written after every stage, by way of a
temporary file, so that an interrupted run leaves a state that the next one understands.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from design.files import write_text

MANIFEST = "manifest.json"


def digest_bytes(data: bytes) -> str:
    """SHA-256, hex."""
    return hashlib.sha256(data).hexdigest()


def digest_file(path: Path) -> str:
    """SHA-256 of a file's content, hex."""
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def digest_json(value: Any) -> str:
    """SHA-256 of a JSON-able value, independent of key order, hex."""
    return digest_bytes(json.dumps(value, sort_keys=True, allow_nan=False).encode())


@dataclass(frozen=True)
class StageRecord:
    """What is remembered of one stage that ended well."""

    key: str
    outputs: dict[str, str]
    summary: dict[str, Any]
    seconds: float
    peak_mb: float

    def still_valid(self, key: str, folder: Path) -> bool:
        """Whether nothing that went in has changed and all that came out is untouched."""
        return self.key == key and all(
            (folder / name).is_file() and digest_file(folder / name) == digest
            for name, digest in self.outputs.items()
        )


@dataclass
class Manifest:
    """All stages of one run folder, and what they were made with."""

    folder: Path
    facts: dict[str, Any] = field(default_factory=dict)
    stages: dict[str, StageRecord] = field(default_factory=dict)
    report: dict[str, Any] = field(default_factory=dict)
    """Of the report: ``print``, the print's id, and ``files``, name to SHA-256."""

    @staticmethod
    def load(folder: Path) -> Manifest:
        """Read the folder's manifest; an absent or broken one counts as empty."""
        try:
            data = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
            stages = {name: StageRecord(**record) for name, record in data["stages"].items()}
            return Manifest(folder, data["facts"], stages, dict(data.get("report", {})))
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return Manifest(folder)

    @property
    def is_embedded(self) -> bool:
        """Whether the run's print writes vessels in a bath, so that only lumens can be scanned."""
        toolpath = self.facts.get("recipe", {}).get("toolpath") or {}
        return bool(toolpath.get("method") == "embedded")

    @property
    def writes_cords(self) -> bool:
        """Whether what the run's print writes stays solid."""
        toolpath = self.facts.get("recipe", {}).get("toolpath") or {}
        return self.is_embedded and toolpath.get("writes") == "cords"

    def save(self) -> None:
        """Write the manifest."""
        stages = {name: vars(record) for name, record in self.stages.items()}
        data = {"schema": 1, "facts": self.facts, "stages": stages, "report": self.report}
        text = json.dumps(data, indent=1)
        write_text(self.folder / MANIFEST, text + "\n")


def of_simulator(path: Path) -> bool:
    """Whether a file, where it lies, is some run's simulated scan."""
    record = Manifest.load(path.parent).stages.get("scan")
    return record is not None and path.name in record.outputs
