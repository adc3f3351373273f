"""The page in the browser: one HTML file, and scripts that ask the REST API for all they show.

Goes in: nothing. Comes out: files that are served as they are. Begin with `assets.py`; in the
browser with `static/app.js`, `static/ui.js` (the parts all pages are made of), `static/runs.js`
(those of what is being made) and `static/api.js`.
"""
