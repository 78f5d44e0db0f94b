"""Interfaces whose sides are meshed each on its own: from two surface meshes to transfer operators (dual mortar).

``segments`` finds where facets of either side overlap, ``surfaces`` holds two sides and their overlaps, ``duals`` has the
multipliers and what they integrate to; ``assembly`` tells which nodes carry a point and puts all together to what ``operators``
says such an interface carries, ``moving`` again where sides slide on.
"""
