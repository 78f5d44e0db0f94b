"""Random scenes over all features, and relations that their answers must keep.

``scenes`` draws (``layout``: the boxes), ``relations`` turns a scene into another whose answer is known from the first's
(``units``: what every number of the YAML is measured in), ``judge`` solves both and compares (``answers``, ``compare``),
``study`` runs thousands of them in processes that may be ended (``pool``, ``worker``).
"""
