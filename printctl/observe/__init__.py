"""Observe a print by camera, OCT or laser line: inspect at marks, decide, mend gaps, record.

Goes in: a running print, a device, tolerances. Comes out: looks with pictures and decisions, and
inserts for the print. Begin with `observer.py`.
"""
