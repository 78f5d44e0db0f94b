"""Scenes that ranks make together, each its own subdomains and of the neighbours the cells that touch them: nobody holds the whole."""
