"""Layers around a black box that route, share and remember."""
