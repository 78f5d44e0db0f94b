"""Meshes: where they come from (``sources``), whether they are sound (``quality``), their faces, the nodes amid edges."""
