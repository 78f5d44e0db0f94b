"""The codes, one module or folder each."""
