"""`printctl profiles`: list, show, make, check and probe profiles."""

from __future__ import annotations

import sys
from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import Any

import typer
import yaml
from typer.core import TyperGroup

from design.files import write_text
from firmware_profiles import (
    PROFILE_SORTS,
    Printer,
    Syringe,
    find_profile,
    load,
    profile_doubts,
    shipped,
    shipped_text,
)
from firmware_profiles.yaml_file import read_yaml
from printctl.cli.declare import group, json_command
from printctl.cli.machine.new_profile import Question, Sheet, read_answers
from printctl.cli.options import print_note, print_notes, print_result
from printctl.errors import UsageError
from printctl.machine.families import link_facts
from printctl.machine.probing import Row, compare, corrected_profile, query_settings
from printctl.settings import arg, opt


class ProfileGroup(TyperGroup):
    """``printctl profiles NAME`` shows a profile: what is no subcommand is a name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put ``show`` in front where no subcommand is named."""
        if not args or (args[0] not in self.commands and args[0] not in ("--help", "-h")):
            args = ["show", *args]
        return super().parse_args(ctx, args)


@json_command
def show(
    name: str | None = arg("Show one profile in full: shipped name or .yaml file.", None),
    write: Path | None = opt("Copy the shipped profile to this new file, for editing."),
) -> None:
    """List the shipped profiles, or show one with its source.

    `printctl profiles NAME` is short for it. A file of your own is shown with its defaults.
    """
    if write is not None:
        _refuse_target(write, "--write")
        if name is None or name.endswith((".yaml", ".yml")):
            raise UsageError("--write copies a shipped profile: name one of `printctl profiles`")
        write_text(write, shipped_text(PROFILE_SORTS[find_profile(name)[0]], name))
        print_note(f"wrote {write}: give it in place of {name}")
    if name is None:
        all_sorts = PROFILE_SORTS.items()
        known = {sort: {one: load(kind, one) for one in shipped(kind)} for sort, kind in all_sorts}
    else:
        sort, profile = find_profile(name)
        known = {sort: {name: profile}}
    profiles = {
        sort: {one: profile.model_dump(mode="json") for one, profile in named.items()}
        for sort, named in known.items()
    }
    lines = []
    for sort, entries in profiles.items():
        for entry, facts in entries.items():
            lines.append(f"{sort:<8} {entry:<18} {facts['name']}{_sizes(sort, facts)}")
            if name is not None:
                lines += [f"  {key}: {value}" for key, value in facts.items()]
    print_result(profiles, lines)


def _sizes(kind: str, facts: dict[str, Any]) -> str:
    """What one chooses a needle or a syringe by."""
    if kind == "needle":
        return f": bore {facts['inner_mm']:g}, outer {facts['outer_mm']:g} mm"
    if kind == "syringe":
        return f": bore {facts['inner_mm']:g} mm, dead volume {facts['dead_volume_ul']:g} µL"
    if kind == "plate":
        count = facts["rows"] * facts["columns"]
        return f": {count} wells, {facts['well_x_mm']:g} mm, {facts['well_depth_mm']:g} mm deep"
    return ""


@json_command
def probe(
    port: str = opt("Serial port or tcp:HOST:PORT.", ...),
    profile: str = opt("Profile: shipped name or .yaml file.", ...),
    baud: int | None = opt("Baud rate; default: the profile's."),
    write: Path | None = opt(
        "Write the profile with the printer's values to this file: a new one, or the profile's own."
    ),
) -> None:
    """Read a printer's settings and show where they differ from a profile.

    Nothing is changed on the printer. The port is refused while a print holds it. Exit code 1 when
    something differs.
    """
    printer = load(Printer, profile)
    if write is not None and write != Path(profile):  # a file of one's own may be filled in
        _refuse_target(write, "--write")
    settings = query_settings(port, printer, baud)
    rows = compare(settings, printer)
    kin = link_facts(printer).reported_name in settings.firmware.lower()
    differs = [row for row in rows if not row.same]
    facts = {
        "profile": printer.name,
        "firmware": settings.firmware,
        "family_agrees": kin,
        "rows": [asdict(row) for row in rows],
        "notes": list(settings.notes),
        "same": kin and not differs,
    }
    lines = [f"{settings.firmware or 'a firmware that says no name'} on {port}"]
    lines += [] if kin else [f"DIFFERS firmware: the profile says {printer.firmware}"]
    lines += [*map(_line, rows), *(f"note    {note}" for note in settings.notes)]
    # What the profile calls a starting value and the printer can't tell.
    reported = {row.key.partition(".")[0] for row in rows}
    left = [name for name in printer.starting_values if name.partition(".")[0] not in reported]
    if left:
        lines.append(f"note    not told by the printer, measure: {', '.join(left)}")
    print_result(facts, lines)
    if write is not None:
        text = yaml.safe_dump(
            corrected_profile(printer, rows, port, date.today().isoformat()),
            sort_keys=False,
            allow_unicode=True,
            width=100,
        )
        write_text(write, text)
        print_note(f"wrote {write}; `printctl profiles check {write}` looks it over")
    if differs or not kin:
        raise typer.Exit(1)


@json_command
def new(
    file: Path = arg("New .yaml file for the profile."),
    answers: Path | None = opt(
        "Read the answers from this YAML file (key: answer) without prompting; missing answers get "
        "starting values."
    ),
) -> None:
    """Make a printer's profile from at most twelve answers.

    Each is checked at once; Enter takes the value in brackets, which the profile then names as a
    starting value. Nothing is written before the last answer, and no file is replaced.
    """
    _refuse_target(file, "FILE")
    sheet = Sheet(f"Answers given to `printctl profiles new`, {date.today().isoformat()}.")
    given = None if answers is None else read_answers(answers)
    for question in sheet.questions():
        if given is None:
            _ask(sheet, question)
        else:
            sheet.take(question, given.pop(question.key, ""))
    if given:
        raise UsageError(f"--answers {answers}: not for this head: {', '.join(given)}")
    text = sheet.profile_text()
    try:
        with file.open("x", encoding="utf-8") as made:
            made.write(text)
    except FileExistsError:
        raise UsageError(f"FILE {file}: it is there already; name a new file") from None
    except OSError:
        file.unlink(missing_ok=True)  # a half one would be taken for a profile
        raise
    then = [
        f"printctl profiles probe --port auto --profile {file} --write {file}",
        f"printctl profiles check {file}",
    ]
    print_notes(sheet.notes())
    print_result(
        {"file": str(file), "starting_values": read_yaml(text)["starting_values"], "next": then},
        [
            f"wrote {file}; give it as --printer {file}",
            f"next: {then[0]}   asks the machine for what it knows, and fills it in",
            f"then: {then[1]}   says what is left to measure",
        ],
    )


def _ask(sheet: Sheet, question: Question) -> None:
    """Ask on stderr until the answer fits; an empty one is the default."""
    print_note(question.hint)
    while True:
        sys.stderr.write(f"{question.text} [{question.default(sheet.answers)}]: ")
        sys.stderr.flush()
        line = sys.stdin.readline()
        if not line:
            raise UsageError(
                "nothing was written: a question has no answer; begin again, or give --answers"
            )
        try:
            return sheet.take(question, line.strip())
        except UsageError as exc:
            print_note(str(exc))


def _refuse_target(file: Path, name: str) -> None:
    """Refuse to write a profile over a file, or with another ending."""
    if file.suffix not in (".yaml", ".yml"):
        raise UsageError(f"{name} {file}: a profile's file ends in .yaml")
    if file.exists():
        raise UsageError(f"{name} {file}: it is there already; name a new file")


def _line(row: Row) -> str:
    mark = "same   " if row.same else "DIFFERS"
    starting = ", a starting value" if row.starting and not row.same else ""
    return f"{mark} {row.key:<26} printer {row.printer!s:>10}  profile {row.profile!s}{starting}"


@json_command
def check(file: str = arg("Profile: .yaml file or shipped name.")) -> None:
    """Check a profile: keys, bounds, and keys against each other.

    Exit code 1 when it mustn't be used as it is, 2 when it is no profile.
    """
    kind, facts = find_profile(file)
    doubts = profile_doubts(facts, [load(Syringe, name) for name in shipped(Syringe)])
    grave = [doubt for doubt in doubts if doubt.grave]
    found = {"file": file, "sort": kind, "passed": not grave, "doubts": list(map(asdict, doubts))}
    verdict = "not to be used so" if grave else "can be used"
    if len(doubts) > len(grave):
        verdict += f", {len(doubts) - len(grave)} to know or to measure first"
    lines = [f"{kind} {facts.name}: {verdict}"]
    lines += [f"{'FAIL' if one.grave else 'WARN'} {one.key}: {one.text}" for one in doubts]
    print_result(found, lines, not grave)


profiles = group(
    typer.Typer(
        cls=ProfileGroup,
        help="Printers and materials: list, show, make, check, ask a printer.",
    ),
    *(show, new, check, probe),
)
