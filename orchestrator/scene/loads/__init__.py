"""Loads and supports, a file each: the model of its key in the YAML, its rules, and what it makes of faces or cells.

``base`` says what every kind tells of itself; ``registry.ON_FACES`` and ``registry.IN_VOLUMES`` name them. Nothing else asks for
the name of a kind: what comes of an entry are forces at nodes, displacements that are prescribed, or a ground.
"""
