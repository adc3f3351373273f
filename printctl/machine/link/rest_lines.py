"""G-code of a job from a given line on, its coordinates counted from the touch-off point."""

from __future__ import annotations

from printctl.machine.link.grown_text import GrownText
from printctl.machine.link.job import Job
from printctl.machine.link.job_frame import JobFrame, Place
from printctl.machine.link.modal import declared_axes
from sim.gcode.reading import is_motion


def rest_lines(job: Job, text: GrownText, begin: int, frame: JobFrame) -> bytes:
    """Return the job's text from command line ``begin``, after what it last said of its height.

    What a line adds to the count of the touch-off is taken off its places, so that a line that
    calls a place otherwise (G92) names the place where the tip stands anyway.
    """
    lines, first = list(text.lines), text.row_of[begin]
    said = (line for line in reversed(lines[:first]) if line.startswith(b";HEIGHT:"))
    for index in range(begin, len(job)) if frame.renamed else ():
        shift, row = frame.shift_at(index), text.row_of[index]
        if any(shift) and (is_motion(job.lines[index]) or declared_axes(job.lines[index])):
            _, semicolon, comment = lines[row].rstrip(b"\r\n").partition(b";")
            lines[row] = _moved(job.lines[index], shift) + semicolon + comment + b"\n"
    return b"".join([next(said, b""), *lines[first:]])


def _moved(line: bytes, shift: Place) -> bytes:
    """Take ``shift`` off the places that a line names as it is sent."""
    by = dict(zip((b"X", b"Y", b"Z"), shift, strict=True))
    code, *words = line.split(b" ")
    return b" ".join([code, *(_word(word, by.get(word[:1], 0.0)) for word in words)])


def _word(word: bytes, shift_mm: float) -> bytes:
    if not shift_mm:
        return word
    letter = word[:2] if word[1:2] == b"=" else word[:1]
    value = b"%.5f" % (float(word[len(letter) :]) - shift_mm)
    return letter + value.rstrip(b"0").rstrip(b".")
