"""Polycrystals: Voronoi cells and their surfaces."""
