"""Meshes: where they come from, whether they are sound, their faces and the nodes of ten-node tets.

``sources`` knows the keys under ``mesh:`` and the module of each: ``structured``, ``files``, ``cad`` (and
``grains.polycrystal``). ``quality`` refuses what is no mesh and measures the shape of cells, ``geometry`` gives areas and volumes, ``faces`` pairs
faces, ``patch`` measures patches of them at their nodes; ``mending`` makes bad
cells better where they are, on ``stars``, a mesh that may change; ``quadratic`` adds mid-edge nodes.
"""
