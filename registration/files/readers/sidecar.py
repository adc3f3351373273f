"""Read a scan's sidecar metadata (``NAME.json`` or ``NAME.yaml``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from firmware_profiles.yaml_file import read_yaml
from registration.errors import ScanFileError
from registration.files.readers.metadata import known_keys, parse

RAW_KEYS = ("shape", "dtype", "offset_bytes", "byte_order", "spectra")
"""What a raw file's sidecar says besides: how its numbers lie, and what spectra are."""

_SUFFIXES = (".json", ".yaml", ".yml")


def sidecar(path: Path, more: tuple[str, ...] = ()) -> dict[str, Any]:
    """Metadata in a JSON or YAML file of the scan's name, if there is one.

    Raises
    ------
    ScanFileError
        When it can't be parsed, or holds a key that isn't known.
    """
    beside = find_sidecar(path)
    if beside is None:
        return {}
    text = beside.read_text(encoding="utf-8")
    if beside.suffix == ".json" and not more:
        return parse(text, str(beside))
    try:
        # JSON is YAML.
        plain = read_yaml(text)
    except yaml.YAMLError as exc:
        raise ScanFileError(f"{beside}: not YAML ({exc}); mend or remove it") from exc
    return known_keys(plain, str(beside), more)


def find_sidecar(path: Path) -> Path | None:
    """The sidecar file of a scan, or None."""
    for suffix in _SUFFIXES:
        place = path.with_suffix(suffix)
        if place != path and place.is_file():
            return place
    return None
