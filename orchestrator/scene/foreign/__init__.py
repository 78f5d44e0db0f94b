"""Parts whose mesh is not ours: what the scene knows of them are their joints.

``joints`` says what a joint is, ``tables`` and ``deck`` read it from the part's own files, ``standin`` makes the thin layer
of tets that stands for the part in all that is geometry. What is behind the joints is known to the black box alone.
"""
