"""`printctl doctor`: say whether this machine is fit, and what to mend."""

from __future__ import annotations

from collections.abc import Iterator

from printctl.cli.declare import json_command
from printctl.cli.kernels_ready import have_kernels
from printctl.cli.options import print_result
from printctl.doctor import Examination, examine
from printctl.settings import opt


@json_command
def doctor(
    warm: bool = opt("Compile all kernels now, so that no run waits for them.", False),
) -> None:
    """Say whether this machine is fit: packages, extras, ports, disk, kernels, folders, clock.

    What it finds comes last, each with its remedy. Nothing is changed but by --warm, and no port
    is opened.
    """
    if warm:
        have_kernels(fewest=1)
    examination = examine()
    print_result(examination.as_dict(), _lines(examination), not examination.blocked)


def _lines(examination: Examination) -> Iterator[str]:
    for section, entries in examination.facts.items():
        yield section
        yield from [f"  {key:<20} {value}" for key, value in entries.items()] or ["  none"]
    yield ""
    if not examination.findings:
        yield "nothing to complain of"
    for one in sorted(examination.findings, key=lambda one: not one.blocks):
        yield f"{'BLOCKS' if one.blocks else 'note'}: {one.text}"
