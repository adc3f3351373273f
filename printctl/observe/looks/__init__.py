"""Facts of one inspection: expected ink, evidence, heights, views.

Goes in: pictures and the job. Comes out: evidence about lines. Begin with `look_context.py`.
"""
