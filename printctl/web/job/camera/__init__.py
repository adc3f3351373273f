"""Camera at the printer: a live picture about once a second, and a time-lapse per print.

Goes in: a camera or files. Comes out: the latest picture, and films of prints. Begin with
`service.py`.
"""
