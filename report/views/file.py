"""Save and load a registration's report pictures as one ``.npz`` file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from design.files import write_bytes
from report.views.findings import FindingView, Panel
from report.views.stack import SectionStack
from report.views.take_pictures import Views

_PANELS = ("b_scan", "reslice")
_ARRAYS = ("grey", "extent_mm", "mark_mm", "design", "measured")
_STACK = ("vessel", "index", "radius", "half", "grey", "wall", "total")


def save_views(path: Path, views: Views) -> None:
    """Write pictures as .npz; same pictures, same bytes.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    arrays: dict[str, Any] = {f"stack_{name}": getattr(views.sections, name) for name in _STACK}
    arrays |= {
        "facts": [views.finding_count, views.root, views.raw],
        "findings": [v.finding for v in views.findings],
        "at_section": [-1 if v.section is None else v.section for v in views.findings],
    }
    for k, view in enumerate(views.findings):
        for name in _PANELS:
            shown: Panel = getattr(view, name)
            arrays |= {f"{k}_{name}_{key}": getattr(shown, key) for key in ("title", *_ARRAYS)}
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    write_bytes(path, stream.getvalue())


def load_views(path: Path) -> Views:
    """Read back what `save_views` wrote."""
    with np.load(path, allow_pickle=False) as held:
        stack = {name: held[f"stack_{name}"] for name in _STACK}
        count, root, raw = held["facts"].tolist()
        findings = [
            FindingView(
                int(number),
                _panel(held, f"{k}_b_scan"),
                _panel(held, f"{k}_reslice"),
                None if at < 0 else int(at),
            )
            for k, (number, at) in enumerate(zip(held["findings"], held["at_section"], strict=True))
        ]
        total = int(stack.pop("total"))
        return Views(
            SectionStack(**stack, total=total), tuple(findings), int(count), bool(root),
            bool(raw),
        )  # fmt: skip


def _panel(held: Any, name: str) -> Panel:
    left, right, bottom, top = held[f"{name}_extent_mm"].tolist()
    across, deep = held[f"{name}_mark_mm"].tolist()
    return Panel(
        str(held[f"{name}_title"]),
        held[f"{name}_grey"],
        (left, right, bottom, top),
        (across, deep),
        held[f"{name}_design"],
        held[f"{name}_measured"],
    )
