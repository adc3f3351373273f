"""Looks at an observed print for the Job page: records, pictures, the operator's answer.

Goes in: the print's folder. Comes out: looks as they were judged, small pictures, an answer for the
observer. Begin with `look_service.py`.
"""
