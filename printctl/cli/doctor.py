"""`printctl doctor`: check that this computer can design and print."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.cli.doctor_checks import Examination, examine
from printctl.cli.options import JsonFlag, print_json, print_lines


def doctor(
    warm: Annotated[
        bool, typer.Option("--warm", help="Compile all kernels now, so that no run waits for them.")
    ] = False,
    as_json: JsonFlag = False,
) -> None:
    """Say whether this machine is fit: packages, extras, ports, disk, kernels, folders, clock.

    What it finds comes last, each with its remedy. Nothing is changed but by --warm, and no port
    is opened.
    """
    if warm:
        from kernels.ahead import missing, needed_kernels
        from printctl.cli.kernels_ready import compile_with_bar

        rows = missing(needed_kernels())
        if rows:
            compile_with_bar(rows)
    examination = examine()
    if as_json:
        print_json(examination.as_dict())
    else:
        _tell(examination)
    if examination.blocked:
        raise typer.Exit(1)


def _tell(examination: Examination) -> None:
    for section, entries in examination.facts.items():
        lines = [f"  {key:<20} {value}" for key, value in entries.items()] or ["  none"]
        print_lines(section, *lines)
    print_lines("", *_verdict(examination))


def _verdict(examination: Examination) -> list[str]:
    if not examination.findings:
        return ["nothing to complain of"]
    order = sorted(examination.findings, key=lambda one: not one.blocks)
    return [f"{'BLOCKS' if one.blocks else 'note'}: {one.text}" for one in order]
