"""`printctl lumens`: predict from any slicer's G-code how wide each designed lumen stays open."""

from __future__ import annotations

from printctl.checks.lumens.words import lumen_lines
from printctl.cli.declare import json_command, wants_json
from printctl.cli.options import GcodeArg, print_note, print_notes, print_result, read_gcode_file
from printctl.errors import SafetyError
from printctl.failures import error_facts
from printctl.pipeline.job.lumens_in_gcode import LumenQuestion, check_lumens
from printctl.settings import opt, three_numbers


@json_command
def lumens(
    *,
    file: GcodeArg,
    requested: LumenQuestion,
    place: str | None = opt("The part's origin in the printer's frame, mm.", metavar="X,Y,Z"),
    every: bool = opt("A row for every lumen.", False, "--all"),
) -> None:
    """Predict how open each lumen will be: diameter, conductance, closed layers, leaks.

    Of layers what they leave open; of an embedded print what its filaments make open. Ends with
    exit code 3 when a lumen is closed or leaks.
    """
    at = None if place is None else three_numbers(place, "--place")
    check, found = check_lumens(file, read_gcode_file(file), requested, at, print_note)
    facts = {"file": str(file), "place_mm": found.tolist(), **check.as_dict()}
    refusal = None if check.refusal is None else SafetyError(check.refusal)
    failed = error_facts(refusal, str(refusal), 3) if refusal else {}
    print_result(facts | failed, lambda: lumen_lines(facts, every))
    if not wants_json():
        print_notes(facts["notes"])
    if refusal is not None:
        raise refusal
