"""Cutting a mesh into subdomains, and numbering them."""
