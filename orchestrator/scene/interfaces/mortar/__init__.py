"""Interfaces whose sides are meshed each on its own: from two surface meshes to transfer operators (dual mortar).

``segments`` finds where facets of either side overlap, ``surfaces`` holds two sides and their overlaps, ``duals`` has the
multipliers and what they integrate to; ``operators`` tells which nodes carry a point and what such an interface carries,
``moving`` makes it again where sides slide on, ``fitting`` puts bonded curved faces onto each other.
"""
