"""Commission a printer: guided steps from profile to correction, each ended by a check.

Goes in: the printer's own profile file and answers. Comes out: a profile, calibrations and one JSON
file of what was done. Begin with `steps.py`.
"""
