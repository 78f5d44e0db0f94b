"""Polycrystals: Voronoi cells in a box, their vertices merged where they are narrow, their faces and their mesh."""
