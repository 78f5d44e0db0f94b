"""Iterations, bounds and true errors."""
