"""Where subdomains meet, and which law holds there.

``patches`` finds faces that are shared and calls for the rest: ``pairing`` opposite faces whose nodes match, ``facing`` and
``nonmatching`` those that do not, ``hinges`` what hangs together by nodes alone. ``entries`` tells which entry of the YAML
governs a pair, ``distances`` how far apart sides are, ``neighbours`` what has no interface though it is near. Once it is known
what is prescribed, ``freedom`` and ``carrying`` say where laws act, with the operators of ``mortar``.
"""
