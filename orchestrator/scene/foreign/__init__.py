"""Parts whose mesh is not ours: what the scene knows of them are their joints, what the black box
solves is their stiffness there.

A kind of part is a module with a function ``joints(part, path, name)``: ``tables`` (beside a
matrix), ``deck``, ``program``. ``standin`` makes the thin layer of tets that stands for the part in
all that is geometry. ``condensed`` brings a stiffness to the joints and judges it, ``matrix`` has
it from a file, ``answers`` from what a program answers; a deck's is CalculiX's
(``blackbox.codes.calculix.deck``). ``blackbox.codes.parts`` answers for all of them.
"""
