"""Records of a print on the disk: journal, contact file, notes, history of all prints.

Goes in: events of a print. Comes out: its record, replayed. Begin with `journal.py`.
"""
