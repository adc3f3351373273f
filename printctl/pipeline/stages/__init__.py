"""Pipeline stages, one file each: inputs, dependencies, work."""
