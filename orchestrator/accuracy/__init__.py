"""Runs repeated on finer meshes until the error is what was asked for."""
