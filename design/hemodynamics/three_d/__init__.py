"""Flow resolved in space: meshes of lumens, and finite elements on them."""
