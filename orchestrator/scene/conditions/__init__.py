"""Supports, loads, materials and codes, resolved to nodes and cells; rigid motions that supports leave."""
