"""Soles: matter glued to interfaces, its outer face clamped (paper, section 3.2).

Added to a subdomain's mesh, a sole turns a standard elasticity solve into a Robin solve: its
stiffness, condensed on the interface, is the search direction k⁻. With one layer of linear
elements the outer nodes are all clamped, so that the condensation is a mere restriction.

Four kinds:

- ``layer`` (the paper's): each side carries a layer along its own outward normal;
- ``symmetric``: each side carries a layer along +n and one along −n, half the modulus each.
  Both sides then see the very same stiffness, which makes the two search directions conjugate;
- ``overlap``: a copy of the first row of elements of both sides;
- ``springs``: a layer so thin that the nodes hardly feel each other, as contact laws, which are
  pointwise, like it. Modulus and thickness shrink together: E/thickness is what counts.

``sole`` says what a sole is, ``facets`` which moduli and thickness it should have, ``prisms`` makes
layers, ``overlap`` copies of elements, ``difficulty`` tells where layers do not do, and ``make`` chooses
the kind and makes the soles of all interfaces.
"""
