"""Observe a print: look at marks, judge what lies there, decide, mend, record.

Goes in: a running print, a device, tolerances. Comes out: looks with pictures and decisions, and
inserts for the print. Begin with `mending/plan.py`.
"""
