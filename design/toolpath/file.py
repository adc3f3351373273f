"""Save and load a toolpath as an `.npz` file."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, Final, Literal, cast

import numpy as np

from design.files import atomic_replacement
from design.toolpath.toolpath import Toolpath

_OTHERS: Final = ("source_kind", "layer_height_mm", "heights_mm")
_ARRAYS: Final = tuple(field.name for field in fields(Toolpath) if field.name not in _OTHERS)


def save_toolpath(path: Path, toolpath: Toolpath) -> None:
    """Write as ``.npz``; the name is taken only by a whole file."""
    arrays: dict[str, Any] = {name: getattr(toolpath, name) for name in _ARRAYS}
    arrays["source_kind"] = np.array(toolpath.source_kind)
    arrays["layer_height_mm"] = np.array(toolpath.layer_height_mm)
    arrays["heights_mm"] = np.array(sorted(toolpath.heights_mm.items())).reshape(-1, 2)
    with atomic_replacement(path) as draft, draft.open("wb") as handle:
        np.savez(handle, **arrays)


def load_toolpath(path: Path) -> Toolpath:
    """Read what `save_toolpath` wrote."""
    with np.load(path, allow_pickle=False) as data:
        arrays = {name: data[name] for name in _ARRAYS}
        kind = cast(Literal["layer", "vessel"], str(data["source_kind"]))
        return Toolpath(
            **arrays,
            source_kind=kind,
            layer_height_mm=float(data["layer_height_mm"]),
            heights_mm={int(layer): mm for layer, mm in data["heights_mm"].tolist()},
        )
