"""Format a network's measures, beside published values, as lines of text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

Numbers = dict[str, Any]
_NAME, _VALUE = 46, 12
_FORKS: Final = {
    "between_deg": "angle of children, degrees",
    "wider_deg": "wider child's turn",
    "narrower_deg": "narrower child's turn",
    "diameter_ratio": "narrower over wider diameter",
    "area_ratio": "children's area over parent's",
}


def measure_lines(numbers: Numbers) -> list[str]:
    """`design.measures.measures_dict` for a terminal, a line a measure, by sections."""
    lines = [*_size(numbers)]
    for title, key in (("Supply by all lumens", "supply"), (_printable(numbers), "printable")):
        if numbers[key] is not None:
            lines += ["", title, *_supply(numbers[key])]
    if numbers["options"]["printable_diameter_mm"] is not None and numbers["printable"] is None:
        lines += ["", _printable(numbers), "  none is as wide"]
    lines += [*_branching(numbers), *_flow(numbers)]
    for kind, tables in numbers["morphometry"].items():
        for name in ("strahler", "diameter_defined"):
            lines += ["", *_orders(kind, name, tables[name])]
    if "against" in numbers:
        lines += ["", *_against(numbers["against"])]
    return lines


def _against(numbers: Numbers) -> Iterator[str]:
    """A published table beside the network's, a line an order."""
    yield f"Arteries against {numbers['table']} ({numbers['source']})"
    if numbers["orders"]:
        heads = ("diameter, mm", "length, mm", "length/diameter")
        yield "  order  elements  " + "".join(f"{one:<30}" for one in heads).rstrip()
    for row in numbers["orders"]:
        cells = (_beside(row[key]) for key in ("diameter_mm", "length_mm", "length_over_diameter"))
        yield f"  {row['order']:>5}{row['elements']:>10}  " + "".join(f"{one:<30}" for one in cells)
    for name, value in numbers["ratios"].items():
        yield f"  {name.replace('_', ' '):<17}  {_beside(value)}"
    yield from _forks(numbers["forks"])
    yield "  Not compared: " + "; ".join(numbers["left_out"])


def _forks(rows: list[Numbers]) -> Iterator[str]:
    """Angles and asymmetry at forks beside published ones, a line each."""
    yield f"  {'forks':<43}{'ours':<18}published"
    for row in rows:
        which = _FORKS[row["measure"]] + (" (first forks)" if row["at"] == "first" else "")
        ours = "–" if row["ours"] is None else f"{row['ours']:.3g} ± {row['ours_sd']:.2g}"
        if row["mean"] is None:
            yield f"  {which:<43}{ours:<18}no published figure"
            continue
        says = {True: "inside", False: "OUTSIDE", None: ""}[row["inside"]]
        yield f"  {which:<43}{ours:<18}{row['mean']:.3g} ± {row['sd']:.2g} {says}".rstrip()
        yield f"    {row['source']}" + (f"; {row['note']}" if row["note"] else "")


def _beside(value: Numbers) -> str:
    """Ours, the published mean ± sd, and whether it is inside."""
    if value["ours"] is None:
        return "–"
    mean = "–" if value["mean"] is None else f"{value['mean']:.3g}"
    spread = "–" if value["sd"] is None else f"{value['sd']:.2g}"
    says = {True: "inside", False: "OUTSIDE", None: ""}[value["inside"]]
    return f"{value['ours']:.3g} ({mean} ± {spread}) {says}"


def _row(name: str, value: float | None, unit: str = "") -> str:
    text = "–" if value is None else str(value)
    if isinstance(value, float):
        # No powers of ten for what has only grown long.
        text = f"{value:.0f}" if 1e4 <= abs(value) < 1e9 else f"{value:.4g}"
    return f"  {name:<{_NAME}}{text:>{_VALUE}} {unit}".rstrip()


def _printable(numbers: Numbers) -> str:
    width = numbers["options"]["printable_diameter_mm"]
    return f"Supply by lumens of {width:g} mm and more" if width else ""


def _size(numbers: Numbers) -> Iterator[str]:
    yield "Network"
    yield _row("vessels", numbers["vessels"])
    yield _row("inlets", numbers["inlets"])
    yield _row("outlets", numbers["outlets"])
    yield _row("length", numbers["length_mm"], "mm")
    yield _row("volume of the lumens", numbers["volume_mm3"], "mm³")
    yield _row("surface of the lumens", numbers["surface_mm2"], "mm²")
    yield _row("thinnest diameter", numbers["diameter_least_mm"], "mm")
    yield _row("widest diameter", numbers["diameter_greatest_mm"], "mm")
    yield _row("volume of the tissue", numbers["tissue_mm3"], "mm³")


def _supply(supply: Numbers) -> Iterator[str]:
    oxygen = supply["oxygen"]
    yield _row("tissue to the nearest lumen, mean", 1e3 * supply["distance_mean_mm"], "µm")
    yield _row(
        "tissue to the nearest lumen, 95th percentile", 1e3 * supply["distance_p95_mm"], "µm"
    )
    yield _row("tissue to the nearest lumen, farthest", 1e3 * supply["distance_max_mm"], "µm")
    for limit, share in supply["beyond"].items():
        yield _row(f"tissue beyond {limit.removesuffix('_um')} µm", 100.0 * share, "%")
    yield _row("share of the volume that is lumen", 100.0 * supply["lumen_fraction"], "%")
    yield _row("vessels per section", supply["vessels_per_mm2"], "1/mm²")
    for axis, count in zip("xyz", supply["sections_per_mm2"], strict=True):
        yield _row(f"  of sections across {axis}", count, "1/mm²")
    yield _row("Krogh's cylinder, radius", 1e3 * oxygen["cylinder_mm"], "µm")
    yield _row("oxygen (estimate), mean", oxygen["mean_millimolar"], "mM")
    yield _row("oxygen (estimate), 5th percentile", oxygen["p5_millimolar"], "mM")
    yield _row("tissue without oxygen (estimate)", 100.0 * oxygen["anoxic"], "%")


def _branching(numbers: Numbers) -> Iterator[str]:
    murray, ways = numbers["murray"], numbers["ways"]
    if murray is not None:
        yield from (
            "",
            f"Murray's law, exponent {murray['exponent']:g}: Σ r_child^γ / r_parent^γ - 1",
        )
        yield _row("forks", murray["forks"])
        yield _row("residual, mean", murray["mean"])
        yield _row("residual, 95th percentile of its size", murray["p95"])
        yield _row("residual, least", murray["least"])
        yield _row("residual, greatest", murray["greatest"])
    if ways is not None:
        yield from ("", "Ways from inlet to outlet")
        yield _row("vessels on the way, mean", ways["depth_mean"])
        yield _row("vessels on the way, most", ways["depth_max"])
        yield _row("way over straight distance, mean", ways["tortuosity_mean"])
        yield _row("way over straight distance, 95th percentile", ways["tortuosity_p95"])
        yield _row("way over straight distance, most", ways["tortuosity_max"])
        yield _row("the same of single vessels, mean", ways["vessel_tortuosity_mean"])
        yield _row("the same of single vessels, most", ways["vessel_tortuosity_max"])


def _flow(numbers: Numbers) -> Iterator[str]:
    flow = numbers["terminal_flow"]
    if flow is None:
        return
    yield from ("", "Flow of the terminals")
    yield _row("terminals", flow["terminals"])
    yield _row("mean", 0.06 * flow["mean_ul_s"], "mL/min")
    yield _row("spread, (greatest - least) / mean", flow["spread"])
    yield _row("coefficient of variation", flow["cv"])


def _orders(kind: str, name: str, table: Numbers) -> Iterator[str]:
    """The published form: by order, from 1 for the smallest, and the ratios between orders."""
    how = {"strahler": "Strahler's orders", "diameter_defined": "diameter-defined orders"}[name]
    yield f"{kind.capitalize()}, {how}"
    yield (
        f"  {'order':>5}{'segments':>10}{'elements':>10}{'diameter / µm':>20}"
        f"{'element length / mm':>24}"
    )
    for n, segments in enumerate(table["segments"]):
        wide = f"{1e3 * table['diameter_mean_mm'][n]:.4g} ± {1e3 * table['diameter_sd_mm'][n]:.3g}"
        long = f"{table['element_length_mean_mm'][n]:.3g} ± {table['element_length_sd_mm'][n]:.2g}"
        yield f"  {n + 1:>5}{segments:>10}{table['elements'][n]:>10}{wide:>20}{long:>24}"
    ratios = [
        f"{label} {table[key]:.3g}"
        for label, key in (
            ("branching", "branching_ratio"),
            ("diameter", "diameter_ratio"),
            ("length", "length_ratio"),
        )
        if table[key] is not None
    ]
    if ratios:
        yield f"  ratio from order to order: {', '.join(ratios)}"
    if len(table["segments"]) > 1:
        yield "  connectivity (elements of order row that spring from one of order column):"
        count = len(table["segments"])
        yield "  " + " " * 5 + "".join(f"{n + 1:>9}" for n in range(count))
        for n, row in enumerate(table["connectivity"]):
            yield f"  {n + 1:>5}" + "".join(f"{value:>9.3g}" for value in row)
