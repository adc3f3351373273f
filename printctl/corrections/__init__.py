"""Corrections from measured prints to the next one.

Goes in: registrations of prints. Comes out: a compensation file. Begin with
`feedback/estimate.py`.
"""
