"""Keys that other programs have and this one has not: what to do instead, in place of the nearest word."""

from __future__ import annotations

# What to do → the words for it. None of them is a key of this program's own, in whatever mapping.
_WORDS: dict[str, tuple[str, ...]] = {
    "write an entry of boundary with motion: {rotate: {axis: z, degrees: 0.1, about: [0, 0, 0]}}":
        ("rx", "ry", "rz", "rotation"),
    "write an entry of boundary with resultant: {force: [0, 0, 1], moment: [0, 0, 0], about: [0, 0, 0]}":
        ("moment", "torque", "total_force", "remote_force", "remote_load"),
    "write an entry of boundary with coupling: {about: [0, 0, 40], displacement: [0, null, null], force: [0, 10, 0]}":
        ("coupling", "remote_displacement", "rigid_body", "rbe2", "rbe3", "remote_point"),
    "write an entry of boundary with foundation: {normal: 1.0e4}, force per area and per length":
        ("foundation", "spring", "springs", "bedding", "elastic_support", "elastic_foundation", "winkler"),
    "write an entry of bolts: [{on: bolt_1, force: 8000}]":
        ("preload", "bolt_pretension", "bolt_load"),
    "write symmetry: true in an entry of boundary, on a plane across an axis":
        ("symmetry", "symmetric", "symmetry_plane", "roller", "slider"),
    "not supported; periodic and cyclic bodies are modelled whole, or cut along planes of symmetry":
        ("antisymmetry", "periodic", "cyclic", "cyclic_symmetry"),
    "write expansion: in materials and loads: [{on: plate, temperature: 80}]; how heat spreads plays no part":
        ("temperature", "expansion", "thermal", "thermal_expansion", "alpha", "heat", "conductivity", "initial_temperature"),
    "write loads: [{gravity: [0, 0, -9810]}], with density: 7.85e-9 in materials (steel in t, mm, s)":
        ("weight", "rho", "acceleration", "mass", "gravity", "density"),
    "write loads: [{spin: {axis: z, rate: 314}}], radians per time, with density: in materials":
        ("centrifugal", "rotational_speed", "omega"),
    "write pressure: {at: [0, 0, 10], gradient: [0, 0, -9.81e-6]} in an entry of boundary":
        ("hydrostatic", "hydrostatic_pressure"),
    "not supported here; contact is a law between parts: interfaces: [{between: [a, b], law: contact, friction: 0.2}]":
        ("contact", "contact_pair", "contacts"),
    "not supported; parts are tied where they share faces: interfaces: [{between: [a, b], law: perfect}]":
        ("tie", "mpc", "constraint", "glue"),
    "not supported; there is no time, only load steps: histories: {ramp: [0.5, 1.0]}, with history: ramp on the entries":
        ("time", "time_step", "dt", "duration", "dynamic", "damping", "frequency", "eigenvalue", "amplitude",
         "initial_condition", "velocity", "load_step"),
    "not supported; matter is linear and isotropic: {young: 200e3, poisson: 0.3}":
        ("plasticity", "plastic", "yield", "yield_stress", "hardening", "creep", "hyperelastic", "orthotropic",
         "anisotropic", "shear_modulus", "bulk_modulus"),
    "not supported; displacements are small and matter is linear, the interfaces' laws alone are not":
        ("nonlinear_geometry", "nlgeom", "large_displacement", "large_deformation", "large_strain", "buckling"),
    "not supported; two dimensions are a slab of one row of elements, its faces held along their normal for plane strain":
        ("plane_stress", "plane_strain", "axisymmetric", "axisymmetry"),
    "not supported; bodies are solid tetrahedra": ("shell", "truss", "cross_section"),
    "write displacement: [0, 0, 0] in an entry of boundary; null leaves a component free":
        ("fixed", "clamped", "clamp", "encastre", "fix", "support", "dirichlet", "ux", "uy", "uz"),
    "write traction: [0, 0, 1], force per area, pressure: 1, or resultant: {force: [0, 0, 1]}, in an entry of boundary":
        ("force", "point_load", "nodal_force", "neumann", "line_load"),
}
_OTHER_NAMES = {"e": "young", "youngs_modulus": "young", "young_modulus": "young", "elastic_modulus": "young", "nu": "poisson",
                "poissons_ratio": "poisson", "poisson_ratio": "poisson", "material": "materials", "bcs": "boundary",
                "bc": "boundary", "boundary_conditions": "boundary", "solver": "method", "geometry": "mesh"}


def _plain(word: str) -> str:
    return word.lower().replace("-", "_").replace(" ", "_").replace("'", "").rstrip("s")


_CURES = {_plain(word): cure for cure, words in _WORDS.items() for word in words}
_NAMES = {_plain(word): name for word, name in _OTHER_NAMES.items()}


def instead(word: str, keys: list[str]) -> str:
    """What to do in place of an unknown key that other programs have; empty where the word is none of those.

    Parameters
    ----------
    keys : those that are known where the word stands; near misspellings of them are not foreign
    """
    plain = _plain(word)
    if (name := _NAMES.get(plain)) in keys:
        return f"write {name}"
    if plain in _CURES and plain not in map(_plain, keys):
        return _CURES[plain]
    return ""
