"""`printctl profiles`: list, show, check and probe profiles of printers and materials."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from firmware_profiles import Syringe, load, profile_doubts, shipped
from printctl.cli.options import JsonFlag, print_json, print_lines
from printctl.cli.profiles_probe import probe
from printctl.cli.profiles_show import ProfileGroup, find_profile, show

# `printctl profiles check`: check a profile for invalid keys and contradictory values.


def check(
    file: Annotated[
        str, typer.Argument(help="A .yaml file, or a shipped name.", show_default=False)
    ],
    as_json: JsonFlag = False,
) -> None:
    """Check a profile: keys, bounds, and keys against each other.

    Exit code 1 when it mustn't be used as it is, 2 when it is no profile.
    """
    kind, facts = find_profile(file)
    doubts = profile_doubts(facts, [load(Syringe, name) for name in shipped(Syringe)])
    grave = [doubt for doubt in doubts if doubt.grave]
    if as_json:
        print_json(
            {
                "file": file,
                "sort": kind,
                "passed": not grave,
                "doubts": [asdict(doubt) for doubt in doubts],
            }
        )
    else:
        rows = [("FAIL" if doubt.grave else "note", doubt) for doubt in doubts]
        print_lines(
            f"{kind} {facts.name}: {'not to be used so' if grave else 'sound'}",
            *(f"{mark} {doubt.key}: {doubt.text}" for mark, doubt in rows),
        )
    if grave:
        raise typer.Exit(1)


profiles = typer.Typer(
    cls=ProfileGroup, help="Known printers and materials: list, show, check, ask a printer."
)
profiles.command("show")(show)
profiles.command("check")(check)
profiles.command("probe")(probe)
