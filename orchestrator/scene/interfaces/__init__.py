"""Where subdomains meet, and which law holds there.

``patches`` finds faces that are shared, ``pairing`` opposite faces whose nodes match; ``entries`` tells which entry of
the YAML governs a pair; ``shared_normals`` gives one normal to contact surfaces that are split over several interfaces.
"""
