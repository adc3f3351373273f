"""Parse G-code lines by the firmware family's grammar, and render them in one unambiguous form.

`read_line` reads one line as the printer's firmware family reads it, or refuses it with the reason.
`read_sent` reads back what it rendered, without asking for a printer. Pure Python, without compiled
kernels, so that the printer link can import it at no cost.

Goes in: a line and a firmware family's grammar. Comes out: a `GcodeLine`, or a refusal. Begin with
`read.py`.
"""

from gcode.reading.line import BLANK, GcodeLine
from gcode.reading.read import code_of, is_motion, plunger_word, read_line, read_sent

__all__ = ["BLANK", "GcodeLine", "code_of", "is_motion", "plunger_word", "read_line", "read_sent"]
