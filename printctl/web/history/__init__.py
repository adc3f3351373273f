"""History page of the web interface: list past prints, show and verify records, repeat a print.

Goes in: the index of prints. Comes out: a list, a print's details, its bundle, a repeat. Begin
with `service.py`.
"""
