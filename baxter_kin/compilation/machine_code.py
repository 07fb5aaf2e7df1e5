"""CasADi functions as machine code, where a C compiler is found; never required.

The C that CasADi generates is compiled once and kept (`baxter_kin.compilation.kernel_cache`), under
a name that is a hash of the functions themselves, so another model or version gets another file.
Compilers are tried in turn, and what they make is kept only if it loads and computes the same in
another process. Whatever goes wrong, the answer is None and the virtual machine does the work.
"""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import version
from pathlib import Path

import casadi as ca

from baxter_kin.compilation import agreement
from baxter_kin.compilation.agreement import loaded
from baxter_kin.compilation.compiler import FLAGS, Compiler, compilers
from baxter_kin.compilation.kernel_cache import KernelCache, kernel_caches
from baxter_kin.compilation.limited_process import run_within
from baxter_kin.errors import FileError

TRIAL_S = 60.0
"""How long the trial of a library may take; half a second is usual."""

_FAILED: set[Compiler] = set()
"""Compilers that have failed in this process; they are not asked again."""

log = logging.getLogger(__name__)


def compiled(
    functions: Sequence[ca.Function],
    alongside: Callable[[], Iterable[Sequence[ca.Function]]] = tuple,
) -> tuple[ca.Function, ...] | None:
    """The same functions as machine code; None without a compiler or when anything fails.

    Args:
        functions: which share a library.
        alongside: makes those of other libraries that are compiled whenever this one has to be, so
            that who needs them later need not wait.
    """
    found = compilers()
    if not found:
        log.debug("no C compiler found; using CasADi's virtual machine")
        return None
    key = _key(functions)
    try:
        for cache in kernel_caches():
            library = cache.library(key)
            machine_code = None if library is None else loaded(functions, str(library))
            if machine_code is None and cache.is_writable:
                machine_code = _made(functions, key, cache, found)
                if machine_code is not None and cache.is_lasting:
                    _make_missing(alongside(), cache, found)
            if machine_code is not None or cache.is_writable:
                return machine_code
    except (OSError, FileError) as cause:
        log.warning("cannot compile a kernel (%s); using CasADi's virtual machine", cause)
    return None


def _make_missing(
    kernels: Iterable[Sequence[ca.Function]], cache: KernelCache, found: Sequence[Compiler]
) -> None:
    for functions in kernels:
        key = _key(functions)
        if cache.library(key) is None:
            _made(functions, key, cache, found)


def _key(functions: Sequence[ca.Function]) -> str:
    """A hash of all that the machine code depends on, but for the compiler: all agree."""
    machine = (platform.system(), platform.machine())
    texts = (function.serialize() for function in functions)
    parts = (*texts, version("casadi"), *FLAGS, *machine)
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


def _made(
    functions: Sequence[ca.Function], key: str, cache: KernelCache, found: Sequence[Compiler]
) -> tuple[ca.Function, ...] | None:
    """Compiled by the first compiler that can, and kept."""
    how_often = f"once; kept in {cache.folder}" if cache.is_lasting else "once in this process"
    for compiler in found:
        if compiler in _FAILED or cache.has_note(compiler.version_key):
            continue
        log.info("compiling a kernel with %s: takes some seconds, %s", compiler, how_often)
        with cache.workplace() as folder:
            library = _made_by(compiler, functions, Path(folder), cache)
            if library is not None:
                return loaded(functions, str(cache.keep(key, library)))
    log.debug("no C compiler works; using CasADi's virtual machine")
    return None


def _made_by(
    compiler: Compiler, functions: Sequence[ca.Function], folder: Path, cache: KernelCache
) -> Path | None:
    """A library that computes the same; None from a compiler that is broken, which is noted."""
    try:
        library = compiler.compile(_source(functions), folder)
        if _stands_trial(library, functions):
            return library
        reason = "what it writes does not load, or computes something else"
    except subprocess.TimeoutExpired as cause:
        reason = f"no answer within {cause.timeout:g} s; not asked again until it changes"
        cache.note(compiler.version_key, f"{compiler}: {reason}")
    except subprocess.CalledProcessError as cause:
        reason = f"exit status {cause.returncode}"
    except OSError as cause:
        reason = cause.strerror or str(cause)
    log.warning(
        "%s cannot compile a kernel (%s); another compiler, or else CasADi's virtual machine, "
        "takes its place",
        compiler,
        reason,
    )
    _FAILED.add(compiler)
    return None


def _stands_trial(library: Path, functions: Sequence[ca.Function]) -> bool:
    """Whether it loads and computes the same in another process, which it may kill."""
    saved = [library.with_name(f"{i}.casadi") for i in range(len(functions))]
    for function, path in zip(functions, saved, strict=True):
        function.save(str(path))
    command = (sys.executable, str(agreement.__file__), str(library), *map(str, saved))
    imports = os.pathsep.join(filter(os.path.isabs, sys.path))  # what is found here, is found there
    environment = {**os.environ, "PYTHONPATH": imports}
    try:
        run_within(TRIAL_S, command, library.parent, environment)
    except subprocess.SubprocessError:
        return False
    return True


def _source(functions: Sequence[ca.Function]) -> str:
    generator = ca.CodeGenerator("kernel")
    for function in functions:
        generator.add(function)
    return str(generator.dump())
