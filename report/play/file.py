"""Save and load the playback data of a predicted print as ``.npz``."""

from __future__ import annotations

import json
import zipfile
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np

from design.files import atomic_replacement
from report.errors import ReportError
from report.play.playback import Playback, PlayNote, PlayRows

_COARSE = {"vessel": np.int32, "head": np.int8, "layer": np.int32, "line": np.int32}


def save_played(path: Path, played: Playback) -> None:
    """Write as ``.npz``, compressed.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    columns = {one.name: getattr(played.rows, one.name) for one in fields(PlayRows)}
    for name, kind in _COARSE.items():
        columns[name] = columns[name].astype(kind)
    said = {
        "passes": played.passes,
        "inks": played.inks,
        "wanted": played.wanted,
        "warnings": [asdict(one) for one in played.warnings],
        "notes": played.notes,
    }
    with atomic_replacement(path) as draft:
        np.savez_compressed(
            draft,
            layer_z_mm=played.layer_z_mm,
            said=np.frombuffer(json.dumps(said).encode(), np.uint8),
            **columns,
        )


def load_played(path: Path) -> Playback:
    """Read it back.

    Raises
    ------
    ReportError
        When it isn't such a file.
    OSError
        When it can't be read.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays_file:
            said = json.loads(arrays_file["said"].tobytes())
            columns = {one.name: arrays_file[one.name] for one in fields(PlayRows)}
            z = arrays_file["layer_z_mm"]
    except (ValueError, KeyError, zipfile.BadZipFile) as exc:
        raise ReportError(f"{path} isn't a prediction to play back: {exc}") from exc
    for name in _COARSE:
        columns[name] = columns[name].astype(np.int64)
    warnings = tuple(PlayNote(**one) for one in said.pop("warnings"))
    inks, notes = tuple(said.pop("inks")), tuple(said.pop("notes"))
    return Playback(PlayRows(**columns), **said, layer_z_mm=z, inks=inks, notes=notes,
                  warnings=warnings)  # fmt: skip
