"""Run folder: file names, manifest of stages, registration files."""
