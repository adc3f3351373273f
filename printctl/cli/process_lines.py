"""Format a dry run for the terminal: print time, ink against fillings, needle shaft contacts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from printctl.checks import preflight


def process_lines(dry_run: Mapping[str, Any]) -> list[str]:
    """Time against what the ink's cells have, ink against what is loaded, the needle's shaft."""
    shaft = dry_run.get("clearance")
    return [_time(dry_run), _ink(dry_run), *(preflight.shaft_lines(shaft) if shaft else [])]


def _time(facts: Mapping[str, Any]) -> str:
    changes = int(facts["changes_of_syringe"])
    timed = facts.get("changes_timed", True)
    with_ = f" with {changes} changes of syringe" if changes and timed else ""
    without = f" and {changes} changes of syringe, whose time isn't known" if not timed else ""
    return (
        f"print time {facts['print_time_s'] / 60:.1f} min{with_}{without}; time that the cells "
        f"have: {facts['time_the_cells_have']}"
    )


def _ink(facts: Mapping[str, Any]) -> str:
    fillings = int(facts["fillings"])
    each = "a filling" if fillings == 1 else f"each of {fillings} fillings"
    return (
        f"ink {facts['ink_needed_ul']:.4g} µL: {facts['ink_pushed_ul']:.4g} pushed, "
        f"{facts['ink_left_per_filling_ul']:.3g} left behind by {each}; full, it holds "
        f"{facts['fillings_hold_ul']:.4g} µL"
    )
