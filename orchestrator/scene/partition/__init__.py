"""Cutting a mesh into connected subdomains (slices, grid, METIS, volumes), cutting large ones further, numbering them."""
