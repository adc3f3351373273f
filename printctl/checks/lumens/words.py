"""Format a lumen check's result (open diameters, closed layers, leaks) as lines of text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

Numbers = dict[str, Any]
ROWS: Final = 20
"""Lumens that are shown unless all are asked for: those that lose most."""


def lumen_lines(numbers: Numbers, every: bool) -> list[str]:
    """Words on `LumenCheck.as_dict` or `FilamentCheck.as_dict`, worst lumens first."""
    rows = numbers["lumens"] if every else numbers["lumens"][:ROWS]
    left = len(numbers["lumens"]) - len(rows)
    return [
        *_head(numbers),
        "",
        *(_row(row) for row in (None, *rows)),
        *([f"  … and {left} lumens that lose less (--all shows them)"] if left else []),
        *_closed(numbers["lumens"]),
        *_leaks(numbers["leaks"]),
        *_merges(numbers.get("merges", [])),
    ]


def _head(numbers: Numbers) -> Iterator[str]:
    summary = numbers["summary"]
    yield f"{_what(numbers)}; part's origin at {_at(numbers['place_mm'], 3)} mm"
    yield (
        f"median diameter {summary['diameter_error_median_um']:+.1f} µm from the design, "
        f"{summary['stepped_diameter_error_median_um']:+.1f} after motor steps"
    )
    yield (
        f"conductance against the design: median {100 * summary['conductance_median']:.1f} %, "
        f"least {100 * summary['conductance_least']:.1f} %; after motor steps "
        f"{100 * summary['stepped_conductance_median']:.1f} %, "
        f"{100 * summary['stepped_conductance_least']:.1f} %"
    )
    if numbers["method"] == "layers":
        yield f"{summary['closed']} closed, {summary['leaks']} leaking"
    else:
        yield (
            f"{summary['closed']} not written through, {summary['joints_broken']} of "
            f"{summary['joints']} joints broken, {summary['merges']} merging "
            f"({summary['merges_across_trees']} across trees)"
        )
        yield numbers["meaning"]


def _what(numbers: Numbers) -> str:
    """What was read, and how much of it."""
    count = numbers["summary"]["lumens"]
    if numbers["method"] == "layers":
        return (
            f"{count} lumens among lines of {numbers['line_um']:.0f} µm in layers of "
            f"{numbers['layer_um']:.0f} µm{_bead(numbers['bead_uncertainty_um'])}"
        )
    return (
        f"{count} vessels written in {numbers['passes']} passes of filament, median "
        f"{numbers['filament_um']:.0f} µm"
    )


def _bead(um: list[float]) -> str:
    """What isn't known of the lines' cross-section, in words."""
    if um == [0.0, 0.0]:
        return ""
    return f" (bead not measured: all diameters {um[0]:+.0f} to {um[1]:+.0f} µm)"


def _at(place: list[float], decimals: int = 2) -> str:
    return ", ".join(f"{value:.{decimals}f}" for value in place)


def _row(row: Numbers | None) -> str:
    """One lumen's; None for the heading."""
    if row is None:
        return (
            f"  {'lumen':>6}{'designed':>10}{'narrowest':>11}{'stepped':>9}{'median':>9}"
            f"{'conduct.':>10}{'stepped':>9}{'least':>7}{'layer':>7}  narrowest at / mm\n"
            f"  {'':>6}{'mm':>10}{'mm':>11}{'mm':>9}{'µm off':>9}{'%':>10}{'%':>9}{'%':>7}"
        )
    stepped = row["stepped"]
    layer = "–" if row["layer"] is None else str(row["layer"] + 1)
    return (
        f"  {row['lumen']:>6}{row['designed_mm']:>10.3f}{row['narrowest_mm']:>11.3f}"
        f"{stepped['narrowest_mm']:>9.3f}{row['diameter_error_median_um']:>+9.1f}"
        f"{100 * row['conductance']:>10.1f}{100 * stepped['conductance']:>9.1f}"
        f"{100 * stepped['conductance_least']:>7.1f}{layer:>7}  {_at(row['at_mm'])}"
    )


def _closed(rows: list[Numbers]) -> Iterator[str]:
    for row in rows:
        layers = sorted({*row["closed_layers"], *row["stepped"]["closed_layers"]})
        if layers:
            yield f"CLOSED lumen {row['lumen']} in layer {_spans([k + 1 for k in layers])}"
        elif row["closed"] or row["stepped"]["closed"]:
            here = row if row["closed"] else row["stepped"]
            yield f"NOT WRITTEN THROUGH vessel {row['lumen']}, at {_at(here['at_mm'])} mm"


def _spans(numbers: list[int]) -> str:
    """``3, 7 to 12``."""
    spans: list[list[int]] = []
    for number in numbers:
        if spans and spans[-1][1] == number - 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return ", ".join(f"{a}" if a == b else f"{a} to {b}" for a, b in spans)


def _leaks(leaks: list[Numbers]) -> Iterator[str]:
    for leak in leaks:
        into = leak["into"] if leak["into"] == "outside" else f"tree {leak['into']}"
        at = _at(leak["at_mm"])
        wall = f", wall {leak['wall_mm']:.2f} mm" if "wall_mm" in leak else ""
        layer = leak["layer"] + 1
        yield f"LEAK from tree {leak['tree']} into {into} in layer {layer} at {at} mm{wall}"


def _merges(merges: list[Numbers]) -> Iterator[str]:
    for merge in merges:
        one, other = merge["vessels"]
        trees = merge["trees"]
        of = f"of tree {trees[0]}" if trees[0] == trees[1] else f"of trees {trees[0]}, {trees[1]}"
        yield (
            f"MERGE of vessels {one} and {other} ({of}), {1e3 * merge['neck_mm']:.0f} µm wide at "
            f"{_at(merge['at_mm'])} mm"
        )
