"""Interfaces: where subdomains meet, and which law holds there.

``opposite`` is the one search for facets that lie opposite each other: ``matching`` asks it for those whose nodes match,
``facing`` for those that do not, ``neighbours`` for what is near and has no interface. ``patches`` finds faces that are shared and
calls for the rest, ``hinges`` what hangs together by nodes alone. ``search`` tells which entry of the
YAML governs a pair, ``distances`` how far apart sides are. Once it is known what is prescribed, ``freedom`` and ``carrying`` say
where laws act, with the operators of ``mortar``.
"""
