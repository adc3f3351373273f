"""Inspections (looks) of an observed print on the Job page: records, pictures, operator's answer.

Goes in: the print's folder. Comes out: looks as they were judged, small pictures, an answer for the
observer. Begin with `look_service.py`.
"""
