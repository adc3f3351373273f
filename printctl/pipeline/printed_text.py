"""Text of the G-code that a run's print was given: its file with what was inserted meanwhile."""

from __future__ import annotations

from printctl.link.grown_text import GrownText, grown_text
from printctl.link.job import parse_job
from printctl.link.printed_job import grown_in
from printctl.pipeline.context import RunContext
from printctl.pipeline.stages.printing import JOURNAL_FOLDER
from printctl.run_folder.artefacts import GCODE


def printed_text(context: RunContext) -> GrownText:
    """Put the inserts of the print in a run's folder into its G-code."""
    data = (context.folder / GCODE).read_bytes()
    job = parse_job(data, GCODE, context.printer)
    return grown_text(grown_in(context.folder / JOURNAL_FOLDER, job), data)
