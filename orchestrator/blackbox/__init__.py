"""The black box: finite element codes that solve subdomains without knowing it.

What a code is given (``protocol.Model``): the extended mesh of a subdomain (four-node tets, the soles of its interfaces
among them), materials per region, clamped dofs, and the trace dofs. Dof = 3 * node + component; units are the YAML's.

What it must answer:

- nodal displacements for a batch of nodal forces, a row per load case, in the order asked;
- the stiffness of a mesh with nothing clamped: of the soles (the search direction) and of the subdomains' rims
  (energies, reactions). Stresses follow from the displacements and are not asked for.

On failure a run ends with one message that names the code, the subdomain, the exit code and the log's last lines;
all processes end, and no file is left. ``orchestrator conformance CODE`` checks all of this.

Three ways to take part, from the shortest to the most general:

1. a class with three methods in Python: copy ``template``; ``scikit_fem`` is a worked example. No line is registered;
2. a program that speaks the bytes of ``messages`` on two pipes or files: see ``freefem_scripts/subdomain_server.edp``
   and ``freefem``;
3. a program that reads and writes files of its own: a ``Worker`` that writes decks and reads results, see ``calculix``.
"""
