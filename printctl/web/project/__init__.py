"""The guided way from a shape to a judged print: gallery, sketch of the vessels, checks, rehearsal.

Goes in: recipes and runs of the workspace. Comes out: what a project has reached and what comes
next. Begin with `service.py`.
"""
