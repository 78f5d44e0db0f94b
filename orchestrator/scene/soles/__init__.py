"""Soles: matter added to interfaces."""
