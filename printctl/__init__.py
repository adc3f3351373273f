"""From tissue to registration report: recipe, pipeline, preflight, link, command line."""
