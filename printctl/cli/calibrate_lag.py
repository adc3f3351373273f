"""`printctl calibrate lag`: write a test, or fit pressure lag and flow factor to line widths."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from firmware_profiles import Ink, MeasuredLag, Needle, Printer, Syringe, load
from printctl.calibration import Estimate, Lag, LagPattern, fit_lag, lag_path
from printctl.cli.calibrate_files import Job, write_mended, write_test
from printctl.cli.calibrate_options import At, Csv, Gcode, Write, print_estimates, read_csv_argument
from printctl.cli.options import JsonFlag, PrinterOption, SyringeOption, three_numbers


def lag(
    readings: Csv = None,
    printer: PrinterOption = "generic_marlin",
    syringe: SyringeOption = "hamilton_1ml",
    ink: Annotated[str, typer.Option("--ink", help="Ink profile.")] = "collagen_fresh",
    needle: Annotated[
        str | None,
        typer.Option("--needle", help="The one mounted: a lag is written for it alone."),
    ] = None,
    slow: Annotated[float, typer.Option("--slow", help="mm/s", min=0.01)] = 4.0,
    fast: Annotated[float, typer.Option("--fast", help="mm/s", min=0.01)] = 16.0,
    length: Annotated[float, typer.Option("--length", help="Of each stretch, mm.", min=1)] = 40.0,
    width: Annotated[float, typer.Option("--width", help="Of the line, mm.", min=0.01)] = 0.4,
    layer: Annotated[float, typer.Option("--layer", help="mm", min=0.01)] = 0.2,
    round_bead: Annotated[
        bool, typer.Option("--round/--flat", help="A filament in a bath, or a bead on a plate.")
    ] = False,
    lines: Annotated[int, typer.Option("--lines", help="Of the test.", min=1)] = 3,
    at: At = "40,100,1",
    gcode: Gcode = None,
    write: Write = None,
    as_json: JsonFlag = False,
) -> None:
    """Pressure lag (K, τ) and flow factor: CSV with x_mm along the line and width_mm there.

    With --gcode it writes the G-code of the test: one line, slow and fast in turn, whose width
    follows the pressure late.
    """
    material = load(Ink, ink)
    line = {"slow_mm_s": slow, "fast_mm_s": fast, "length_mm": length, "width_mm": width}
    line |= {"layer_mm": layer, "round": float(round_bead)}
    if gcode is not None:
        path = lag_path(
            _pattern(line),
            lines,
            prime_ul=material.retract_ul,
            flow_ul_s=material.plunger_ul_s,
            spacing_mm=10 * width,
        )
        place = three_numbers(at, "--at")
        mounted = (load(Printer, printer), load(Syringe, syringe))
        # As a print does: what is found then multiplies the factor that the ink has.
        job = Job(gcode, path, *mounted, place, flow_factor=material.flow_factor)
        write_test(job, ("x_mm", "width_mm"), [[f"{x:g}", ""] for x in _places(length)], line)
        return
    data = read_csv_argument(readings, ("x_mm", "width_mm"))
    fit = fit_lag(
        data.numbers["x_mm"],
        data.numbers["width_mm"],
        _pattern(line | data.facts),
        data.last_digit["width_mm"],
    )
    factor = fit.flow_factor.times(material.flow_factor, "")
    tip = None if needle is None else load(Needle, needle)
    print_estimates(
        _lag_estimates(fit, factor), [*_notes(fit), *_unwritten(fit, tip, write)], as_json
    )
    if write is not None:
        lagging = _with_lag(material, fit, tip, load(Syringe, syringe))
        write_mended(write, lagging, "flow_factor", factor)


def _with_lag(ink: Ink, fit: Lag, needle: Needle | None, syringe: Syringe) -> Ink:
    """The ink with its lag, where one number says it and the needle is known."""
    if needle is None or not fit.linear:
        return ink
    lag = MeasuredLag(lag_s=fit.rise_s.value, needle=needle.name, syringe=syringe.name)
    source = f"{ink.source} lag measured by printctl calibrate: {fit.rise_s.text()}, 95 %."
    return ink.model_copy(update={"lag": lag, "source": source})


def _unwritten(fit: Lag, needle: Needle | None, write: Path | None) -> list[str]:
    if write is None:
        return []
    if not fit.linear:
        return ["the lag isn't written: rise and fall differ, so no single number says it"]
    if needle is None:
        return ["the lag isn't written: it holds for one needle; name it (--needle)"]
    return []


def _pattern(line: dict[str, float]) -> LagPattern:
    """The line, as options say it or the CSV file that was written with its G-code."""
    return LagPattern(
        line["slow_mm_s"],
        line["fast_mm_s"],
        line["length_mm"],
        line["width_mm"],
        line["layer_mm"],
        "round" if line["round"] else "flat",
    )


def _lag_estimates(fit: Lag, factor: Estimate) -> dict[str, Estimate]:
    return {
        "flow factor": factor,
        "τ, flow going up": fit.rise_s,
        "τ, flow going down": fit.fall_s,
        "K (advance)": fit.advance_s,
    }


def _notes(fit: Lag) -> list[str]:
    return [
        f"one width scatters by {fit.scatter_mm * 1e3:.3g} µm",
        "rise and fall agree: the ink is linear here"
        if fit.linear
        else "rise and fall differ: the ink holds pressure by its yield stress, so no single K "
        "is right; keep to one speed",
        "printctl sends no advance: set it in the firmware (Marlin M900 K, RepRapFirmware M572 S, "
        "Klipper SET_PRESSURE_ADVANCE) and print the test again",
    ]


def _places(length: float) -> list[float]:
    """Where to measure: close together after the changes of speed."""
    after = [0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.55, 0.75, 0.95]
    steady = [0.55, 0.65, 0.75, 0.85, 0.95]
    return [
        round(length * (stretch + part), 3)
        for stretch, parts in ((0, steady), (1, after), (2, after))
        for part in parts
    ]
