"""Meshes: sources, quality, faces, ten-node tets."""
