"""`printctl profiles probe`: compare a printer's own settings with its profile."""

from __future__ import annotations

from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import Annotated

import typer
import yaml

from design.files import write_text
from firmware_profiles import Printer, load
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.machine.link.families import link_facts
from printctl.machine.probing import Row, compare, corrected_profile, query_settings


def probe(
    port: Annotated[
        str, typer.Option("--port", help="Serial port or tcp:HOST:PORT.", show_default=False)
    ],
    profile: Annotated[
        str,
        typer.Option("--profile", help="A shipped name or a .yaml file.", show_default=False),
    ],
    baud: Annotated[int | None, typer.Option("--baud", help="In place of the profile's.")] = None,
    write: Annotated[
        Path | None,
        typer.Option("--write", help="Write the profile with the printer's values to this file."),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Read a printer's settings and show where they differ from a profile.

    Nothing is changed on the printer. The port is refused while a print holds it. Exit code 1 when
    something differs.
    """
    printer = load(Printer, profile)
    settings = query_settings(port, printer, baud)
    rows = compare(settings, printer)
    kin = link_facts(printer).says in settings.firmware.lower()
    differs = [row for row in rows if not row.same]
    if as_json:
        print_json(
            {
                "profile": printer.name,
                "firmware": settings.firmware,
                "family_agrees": kin,
                "rows": [asdict(row) for row in rows],
                "notes": list(settings.notes),
                "same": kin and not differs,
            }
        )
    else:
        print_lines(f"{settings.firmware or 'a firmware that says no name'} on {port}")
        if not kin:
            print_lines(f"DIFFERS firmware: the profile says {printer.firmware}")
        notes = [f"note    {note}" for note in (*settings.notes, *_untold(printer, rows))]
        print_lines(*(_line(row) for row in rows), *notes)
    if write is not None:
        text = yaml.safe_dump(
            corrected_profile(printer, rows, port, date.today().isoformat()),
            sort_keys=False,
            allow_unicode=True,
            width=100,
        )
        write_text(write, text)
        messages().print(f"wrote {write}; `printctl profiles check {write}` looks it over")
    if differs or not kin:
        raise typer.Exit(1)


def _line(row: Row) -> str:
    mark = "same   " if row.same else "DIFFERS"
    starting = ", a starting value" if row.starting and not row.same else ""
    return f"{mark} {row.key:<26} printer {row.printer!s:>10}  profile {row.profile!s}{starting}"


def _untold(printer: Printer, rows: list[Row]) -> list[str]:
    """What the profile calls a starting value and the printer can't tell."""
    reported = {row.key.partition(".")[0] for row in rows}
    left = [name for name in printer.starting_values if name.partition(".")[0] not in reported]
    return [f"not told by the printer, measure: {', '.join(left)}"] if left else []
