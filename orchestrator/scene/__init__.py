"""Meshes, partition, interfaces and boundary conditions: one scene of subdomains and interfaces."""
