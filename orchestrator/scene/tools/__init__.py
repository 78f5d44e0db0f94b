"""Rigid tools that interfaces are with: their surfaces, how they move, and the faces of parts that they may touch."""
