"""Accelerations of the fixed point."""
