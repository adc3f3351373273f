"""REST API basics: health, event stream, control lock, stop; error responses; API reference page.

Goes in: HTTP requests. Comes out: JSON, and errors in one shape. Begin with `routes.py`.
"""
