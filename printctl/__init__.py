"""The printctl package: recipe, pipeline, preflight, printer link, command line and web page."""
