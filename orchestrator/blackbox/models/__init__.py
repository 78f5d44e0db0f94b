"""From the scene to plain finite element models."""
