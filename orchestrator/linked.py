"""Machine code of compiled loops in libraries of their own, which a process calls without the compiler: numba and LLVM take a process 120
MB, of which 40 are its own.

The compiler's code is position independent here, and linked by ``ld``. A loop is called the way numba calls its own: a place for the
result, one for an exception, then each array as owner, parent, entries, bytes of one, address, shape and strides, and tuples entry after
entry. That this is how the compiler sees it is checked as the library is made. What numba's code calls of its runtime (memory for small
arrays, BLAS) goes through addresses that are filled in as a library is loaded; numba's two modules of C that have them need no compiler.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from importlib.machinery import ExtensionFileLoader
from importlib.metadata import version
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator import __version__
from orchestrator.optional import need

_ARRAY = ("ptr", "ptr", "i64", "i64", "ptr")  # before shape and strides
_C = {"ptr": ctypes.c_void_p, "i64": ctypes.c_int64, "double": ctypes.c_double}
_RESULTS = {"none": ctypes.c_void_p, "bool": ctypes.c_bool, "int64": ctypes.c_int64}
_RUNTIME = {"NRT_": "core/runtime/_nrt_python", "numba_": "_helperlib"}  # prefix of a name → numba's module that has it
_DECLARED = re.compile(r"declare (?:noalias |noundef )*(\w+) @((?:NRT_|numba_)\w+)\((.*?)\)")
_AT = "at."  # + name of what is called: where its address is


class NotLinked(Exception):
    """There is no linker, or the compiler does not call functions this way: whoever calls the loop needs the compiler."""


def kind_of(argument: Any) -> Any:
    """What tells the machine code for one argument from that for another."""
    if isinstance(argument, np.ndarray):
        flags = argument.flags
        return argument.dtype.str, argument.ndim, "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A", flags.writeable, flags.aligned
    return tuple(map(kind_of, argument)) if isinstance(argument, tuple) else type(argument)


def name_of(source: Path, kinds: tuple) -> str:
    """A name for what a library depends on: source, kinds of arguments, versions, processor.

    Raises NotLinked: the processor cannot be told
    """
    return hashlib.sha256(repr((_surroundings(), source.read_bytes(), kinds)).encode()).hexdigest()[:24]


@cache
def _surroundings() -> tuple:
    try:
        told = Path("/proc/cpuinfo").read_text().partition("\n\n")[0]
    except OSError as error:
        raise NotLinked from error
    processor = [line for line in told.splitlines() if line.startswith(("model name", "flags", "Features"))]
    asked = sorted(item for item in os.environ.items() if item[0].startswith("NUMBA_"))
    return sys.version, platform.machine(), processor, asked, Path(__file__).read_bytes(), [version(name) for name in ("numba", "llvmlite", "numpy")], __version__


def make(target: Path, function: Callable[..., Any], arguments: Sequence, options: dict[str, Any]) -> None:
    """Compile a function for such arguments, and link it.

    Raises NotLinked; OSError: it cannot be written
    """
    if not shutil.which("ld"):
        raise NotLinked
    numba = need("numba")
    binding, types = need("llvmlite", "binding"), tuple(map(numba.typeof, arguments))
    dispatcher = numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)(function)
    dispatcher.compile(types)
    made = dispatcher.overloads[types]
    _check(made, arguments)
    try:
        module = binding.parse_assembly(str(made.library._final_module))
        declared = [found.groups() for f in module.functions if f.is_declaration and (found := _DECLARED.search(str(f)))]
        module.link_in(binding.parse_assembly("\n".join(_passed_on(*each) for each in declared)))
    except RuntimeError as error:  # an LLVM that writes its text in another way
        raise NotLinked from error
    module.get_function(made.fndesc.llvm_func_name).name = f"loop_{made.signature.return_type}"
    machine = binding.Target.from_default_triple().create_target_machine(
        cpu=numba.core.config.CPU_NAME or binding.get_host_cpu_name(),
        features=numba.core.config.CPU_FEATURES or binding.get_host_cpu_features().flatten(), opt=3, reloc="pic", codemodel="default")
    code, unfinished = target.with_suffix(f".{os.getpid()}.o"), target.with_suffix(f".{os.getpid()}")
    try:
        code.write_bytes(machine.emit_object(module))
        if subprocess.run(["ld", "-shared", "-o", unfinished, code], capture_output=True).returncode:
            raise NotLinked
        os.replace(unfinished, target)
    finally:
        for path in (code, unfinished):
            path.unlink(missing_ok=True)


def _check(made: Any, arguments: Sequence) -> None:
    """Raises NotLinked: the compiler calls the function in another way."""
    context, pointer = made.target_context, need("llvmlite", "ir").PointerType
    signature = made.signature
    given = context.call_conv.get_function_type(signature.return_type, signature.args).args
    seen = ["ptr" if isinstance(x, pointer) else str(x) for x in given]
    if seen != ["ptr", "ptr", *(x for a in arguments for x in _passed_as(a))] or str(signature.return_type) not in _RESULTS:
        raise NotLinked


def _passed_on(result: str, name: str, types: str) -> str:
    """LLVM's text of a function that calls the one at an address."""
    given = ", ".join(f"{x} %a{i}" for i, x in enumerate(filter(None, types.split(", "))))
    call = f"call {result} %f({given})"
    return (f"@{_AT}{name} = global ptr null\ndefine {result} @{name}({given}) {{\n  %f = load ptr, ptr @{_AT}{name}\n"
            + (f"  {call}\n  ret void\n}}" if result == "void" else f"  %r = {call}\n  ret {result} %r\n}}"))


def _passed_as(argument: Any) -> Iterator[str]:
    """LLVM's types of what an argument is passed as."""
    if isinstance(argument, np.ndarray):
        yield from _ARRAY
        yield from ["i64"] * 2 * argument.ndim
    elif isinstance(argument, tuple):
        for entry in argument:
            yield from _passed_as(entry)
    else:
        yield {int: "i64", np.int64: "i64", float: "double", np.float64: "double"}.get(type(argument), "")


def _passed(argument: Any, result: list) -> None:
    """What an argument is passed as, added to the result."""
    if isinstance(argument, np.ndarray):
        result += (None, None, argument.size, argument.itemsize, argument.ctypes.data, *argument.shape, *argument.strides)
    elif isinstance(argument, tuple):
        for entry in argument:
            _passed(entry, result)
    else:
        result.append(argument)


def load(path: Path, arguments: Sequence) -> Callable[..., Any]:
    """The function in a library, for such arguments.

    Raises OSError: there is none
    """
    library = ctypes.CDLL(str(path))
    returns = next(name for name in _RESULTS if hasattr(library, f"loop_{name}"))
    call, kind = getattr(library, f"loop_{returns}"), _RESULTS[returns]
    call.argtypes = [ctypes.c_void_p, ctypes.c_void_p, *(_C[x] for a in arguments for x in _passed_as(a))]
    for name, address in _addresses().items():
        if hasattr(library, _AT + name):
            ctypes.c_void_p.in_dll(library, _AT + name).value = address

    def called(*arguments: Any) -> Any:
        found, error = kind(), ctypes.c_void_p()
        passed = [ctypes.addressof(found), ctypes.addressof(error)]
        for argument in arguments:
            _passed(argument, passed)
        if status := call(*passed):
            raise ArithmeticError(f"{path.stem}: a compiled loop ends with status {status}")
        return None if returns == "none" else found.value

    return called


@cache
def _addresses() -> dict[str, int]:
    """Addresses of numba's runtime, by the names that its code calls them by."""
    result, place = {}, Path(find_spec("numba").submodule_search_locations[0])
    for prefix, file in _RUNTIME.items():
        path = next(place.glob(f"{file}.*.so"))
        name = path.name.partition(".")[0]
        spec = spec_from_file_location(name, path, loader=ExtensionFileLoader(name, str(path)))
        spec.loader.exec_module(module := module_from_spec(spec))
        result |= {prefix + key: address for key, address in module.c_helpers.items()}
    return result
