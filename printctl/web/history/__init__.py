"""History page of the web interface: past prints, their records, and repeats.

Goes in: the index of prints. Comes out: a list, a print's details, its bundle, a repeat. Begin
with `service.py`.
"""
