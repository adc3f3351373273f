"""Read what inspections saw of an observed print, for the report's figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import read_journal, read_journal_if_any
from printctl.observe.records import look_picture, read_looks
from report.figures.look_figure import LookRow


def look_rows(print_folder: Path, scan_rows: Sequence[Mapping[str, Any]] = ()) -> list[LookRow]:
    """Return each look at a print with what the journal says was done after it.

    Parameters
    ----------
    print_folder : Path
        With the journal; looks of an earlier print in it are left out.
    scan_rows : sequence of dict
        What the final scan has where they looked (`printctl.pipeline.judging.written_in_scan`).
    """
    looks = read_looks(print_folder, read_journal_if_any(print_folder / JOURNAL).started)
    if not looks:
        return []
    scanned = {row["look"]: _share(row["scan_ink"]) for row in scan_rows}
    done = {one.look: one for one in read_journal(print_folder / JOURNAL).inserts}
    rows, flow = [], 1.0
    for look in looks:
        insert = done.get(look.number)
        changed = insert is not None and insert.flow != flow
        flow = insert.flow if insert is not None else flow
        rows.append(
            LookRow(
                look.number,
                _share(look.found.get("coverage")),
                _share(look.found.get("seen_share")),
                mended=insert is not None and len(insert.lines) > 0,
                flow=flow if changed else None,
                held=insert is None and look.decision in ("pause", "stop"),
                picture=look_picture(print_folder, look.number),
                scan=scanned.get(look.number),
            )
        )
    return rows


def _share(value: float | None) -> float:
    return math.nan if value is None else float(value)
