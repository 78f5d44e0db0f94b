"""The scene: a mesh, its subdomains and their interfaces, and what acts on them; ``build`` makes it from a configuration.

Rooms: ``mesh`` (sources, files, faces, ten-node tets, polycrystals), ``loads`` (loads and supports, a file each), ``conditions``
(where they act, whether they agree and hold), ``foreign`` (parts of other programs), ``interfaces`` (where parts meet, under which
law) and ``soles`` (matter glued to interfaces). ``model`` says what a scene is made of; ``partition`` cuts a mesh in subdomains,
``bolts`` across shanks; ``names`` finds things by name; ``congruence`` tells what is the same but for a translation; ``inspection``
lists what a mesh has; ``part`` makes a rank's part, and puts the whole on disk meanwhile.
"""
