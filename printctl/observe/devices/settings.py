"""Data class of a camera's or scanner's settings: kind, source, size, time limit; as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any, Final, Literal

PICTURES: Final = 0.8
"""Share of a look's time limit in which its pictures are taken: the rest is judgement's."""
Kind = Literal["camera", "folder", "command", "simulated"]


@dataclass(frozen=True)
class DeviceSettings:
    """What is needed to acquire one picture or volume.

    Attributes
    ----------
    kind : "camera", "folder", "command" or "simulated"
    source : str
        Of a camera its number or address; of a folder its path; of a command its words.
    size_px : tuple of int or None
        Width and height asked of a camera; None for its own.
    limit_s : float, s
        After which it counts as hung.
    extra : dict
        What one kind alone needs: of ``simulated`` the ``record``, ``faults`` and ``camera`` files.
    tables : bool
        Whether its files may be tables of numbers (`.csv`, `.txt`), as a laser profiler's, or
        folders of pictures, as a laser line's with a camera.
    """

    kind: Kind
    source: str = ""
    size_px: tuple[int, int] | None = None
    limit_s: float = 20.0
    extra: dict[str, Any] = field(default_factory=dict)
    tables: bool = False

    def to_json(self) -> str:
        """As JSON text."""
        return json.dumps(asdict(self))

    @staticmethod
    def from_json(text: str) -> DeviceSettings:
        """Read `to_json`."""
        data = json.loads(text)
        size = data["size_px"]
        return DeviceSettings(**{**data, "size_px": tuple(size) if size else None})
