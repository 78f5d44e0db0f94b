"""``orchestrator check``: what is wrong with a configuration and its mesh, and what should be known before it is solved."""

from __future__ import annotations

from orchestrator.blackbox.start import find_codes
from orchestrator.config.method import Method
from orchestrator.config.model import Config
from orchestrator.method.interface.stabilisation import cautions as stabilisation_cautions
from orchestrator.registry import FOREIGN
from orchestrator.scene.build import build_scene
from orchestrator.scene.cautions import scene_cautions
from orchestrator.scene.foreign.joints import not_asked
from orchestrator.scene.mesh.sources import make_parts
from orchestrator.scene.model import Scene

PAIRS = 50  # that are shown; ``orchestrator inspect`` shows all


def checked(config: Config, run_programs: bool = False) -> list[str]:
    """Lines on a sound scene.

    run_programs : whether programs, interpreters and forms that the configuration names are run; else it is told what is not
        checked therefore: with a program among the parts, all but the meshes, matrices and decks of the others
    Raises InputError: the mesh, the codes or the number of iterations do not fit it
    """
    unsaid = [] if run_programs else not_asked(config)
    if not run_programs and any(part.program for part in config.parts or []):
        return [*_parts_alone(config), *unsaid]
    scene = build_scene(config, run_programs=run_programs)
    for code in find_codes(config.codes, {s.code for s in scene.subdomains}, run_programs).values():
        if run_programs or not code.check_runs:
            code.check()
    _check_iterations(scene, config.method)
    lines = [f"OK: {scene!r}", *unsaid]
    if scene.element is not None:
        lines.append(f"element: {scene.element}")
    lines += _pairs(scene, config)
    return lines + [f"warning: {sentence}" for sentence in [*scene_cautions(scene), *stabilisation_cautions(config.method)]]


def _parts_alone(config: Config) -> list[str]:
    """What is said of the parts that are no programs, each by itself; raises InputError for what is wrong with them."""
    others = [part for part in config.parts if not part.program]
    lines = [f"OK as far as checked: {len(others)} of {len(config.parts)} parts, each by itself"]
    if others:
        mesh, _ = make_parts(config.parts, run_programs=None)
        lines += [f"warning: {remark}" for remark in mesh.remarks]
    meshed = any(part.mesh for part in others)
    used = [i for i, entry in enumerate(config.codes) if entry.code != "program" and (meshed or entry.code in FOREIGN)]
    for code in find_codes(config.codes, used, run_programs=False).values() if used else ():
        if not code.check_runs:
            code.check()
    return lines


def _pairs(scene: Scene, config: Config) -> list[str]:
    """Pairs that have been found rather than named, and those whose meshes do not match."""
    if not any(entry.found for entry in config.interfaces) and all(i.mortar is None for i in scene.interfaces):
        return []
    from orchestrator.scene.inspection.pairs import pairs_of_scene
    from orchestrator.scene.inspection.content import pair_table

    return pair_table(pairs_of_scene(scene), PAIRS)


def _check_iterations(scene: Scene, method: Method) -> None:
    """Whether there are enough of them; where there is no doubt, the method is not even imported."""
    if scene.steps > method.max_iterations:
        from orchestrator.method.load_cases import load_cases
        from orchestrator.method.increments import check_iterations
        from orchestrator.refused import by_keys

        with by_keys():
            check_iterations(len(load_cases(scene, method.skip).chosen), all(i.law.perfect for i in scene.interfaces), method)
