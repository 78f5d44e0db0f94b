"""The black box: finite element codes that solve subdomains without knowing it.

What a code is given (``protocol.Model``): the extended mesh of a subdomain (four-node tets, ten-
node ones with P2; the soles of its interfaces among them), materials per region, clamped dofs, and
the trace dofs. Dof = 3 * node + component; units are the YAML's.

What it must answer:

- nodal displacements for a batch of nodal forces, a row per load case, in the order asked;
- the stiffness of a mesh with nothing clamped: of the soles (the search direction) and of the subdomains' rims
  (energies, reactions). Stresses follow from the displacements and are not asked for.

On failure a run ends with one message that names the code, the subdomain, the exit code and the
log's last lines; all processes end, and no file is left. ``orchestrator conformance CODE`` checks
all of this.

Three ways to take part, from the shortest to the most general:

1. a class with three methods in Python: copy ``codes/template.py`` and name the copy in the YAML, nothing is registered.
   An ``Adapter`` gets a name by a line in ``orchestrator/registry.py``; ``codes/libraries.py`` is a worked example;
2. a program that speaks the bytes of ``transport/messages.py`` on two pipes or files: a ``MessageCode`` of ``codes/code.py`` says how it
   is started and writes its mesh files, see ``codes/freefem`` and the other end, ``freefem_scripts/subdomain_server.edp``;
3. a program that reads and writes files of its own: a ``Code`` with a worker that writes decks and reads results, see ``codes/calculix``.

A code's ``Settings`` are the model of its entries in the YAML; keys that they add are validated
like all others.

``models`` makes plain models of the scene's subdomains; ``pool`` spreads them over processes that
``codes`` start and ``transport`` talks to; ``guard`` judges answers, ``shared`` remembers them;
``trial`` puts a code to the test; ``start`` makes what is asked for.
"""
