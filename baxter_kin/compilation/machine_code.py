"""C as machine code, where a C compiler is found; never required.

C is compiled once and kept (`baxter_kin.compilation.kernel_cache`), under a name that is a hash of
what it is made from, so another model or version gets another file. Compilers are tried in turn,
and what they make is kept only if it stands a trial in another process. Whatever goes wrong, the
answer is None and something slower does the work: for CasADi's functions, its virtual machine.
"""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Protocol, TypeVar

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


T_co = TypeVar("T_co", covariant=True)


class Kernel(Protocol[T_co]):
    """C that can be compiled, and how it is used."""

    @property
    def instead(self) -> str:
        """What does the work where it cannot be compiled."""

    @property
    def key(self) -> str:
        """A hash of all that the machine code depends on, but for the compiler: all agree."""

    @property
    def source(self) -> str:
        """The C."""

    def load(self, library: Path) -> T_co | None:
        """What a library holds, known not to be rubbish; None when it is something else."""

    def trial(self, library: Path) -> Sequence[str]:
        """A command that has exit status 0 if a library holds the kernel; rubbish may kill it.

        Files may be left beside the library.
        """


def compiled(
    functions: Sequence[ca.Function],
    alongside: Callable[[], Iterable[Sequence[ca.Function]]] = tuple,
) -> tuple[ca.Function, ...] | None:
    """CasADi functions as machine code; None without a compiler or when anything fails.

    Args:
        functions: which share a library.
        alongside: makes those of other libraries that are compiled whenever this one has to be, so
            that who needs them later need not wait.
    """
    return built(_Functions(functions), lambda: map(_Functions, alongside()))


def built(
    kernel: Kernel[T_co], alongside: Callable[[], Iterable[Kernel[object]]] = tuple
) -> T_co | None:
    """A kernel as machine code; None without a compiler or when anything fails.

    Args:
        kernel: the C.
        alongside: makes other kernels that are compiled whenever this one has to be.
    """
    found = compilers()
    if not found:
        log.debug("no C compiler found; using %s", kernel.instead)
        return None
    try:
        for cache in kernel_caches():
            library = cache.library(kernel.key)
            loaded = None if library is None else kernel.load(library)
            if loaded is None and cache.is_writable:
                loaded = _made(kernel, cache, found)
                if loaded is not None and cache.is_lasting:
                    _make_missing(alongside(), cache, found)
            if loaded is not None or cache.is_writable:
                return loaded
    except (OSError, FileError) as cause:
        log.warning("cannot compile a kernel (%s); using %s", cause, kernel.instead)
    return None


def key_of(*parts: str | bytes) -> str:
    """A hash of what a kernel is made from, and of how and for what it is compiled."""
    own = (*parts, *FLAGS, platform.system(), platform.machine())
    texts = (part if isinstance(part, bytes) else part.encode() for part in own)
    return hashlib.sha256(b"\0".join(texts)).hexdigest()[:32]


@dataclass(frozen=True)
class _Functions:
    """CasADi functions that share a library."""

    functions: Sequence[ca.Function]
    instead = "CasADi's virtual machine"

    @property
    def key(self) -> str:
        return key_of(*(f.serialize() for f in self.functions), version("casadi"))

    @property
    def source(self) -> str:
        return _source(self.functions)

    def load(self, library: Path) -> tuple[ca.Function, ...] | None:
        return loaded(self.functions, str(library))

    def trial(self, library: Path) -> Sequence[str]:
        saved = [library.with_name(f"{i}.casadi") for i in range(len(self.functions))]
        for function, path in zip(self.functions, saved, strict=True):
            function.save(str(path))
        return (sys.executable, str(agreement.__file__), str(library), *map(str, saved))


def _make_missing(
    kernels: Iterable[Kernel[object]], cache: KernelCache, found: Sequence[Compiler]
) -> None:
    for kernel in kernels:
        if cache.library(kernel.key) is None:
            _made(kernel, cache, found)


def _made(kernel: Kernel[T_co], cache: KernelCache, found: Sequence[Compiler]) -> T_co | None:
    """Compiled by the first compiler that can, and kept."""
    how_often = f"once; kept in {cache.folder}" if cache.is_lasting else "once in this process"
    for compiler in found:
        if compiler in _FAILED or cache.has_note(compiler.version_key):
            continue
        log.info("compiling a kernel with %s: takes some seconds, %s", compiler, how_often)
        with cache.workplace() as folder:
            library = _made_by(compiler, kernel, Path(folder), cache)
            if library is not None:
                return kernel.load(cache.keep(kernel.key, library))
    log.debug("no C compiler works; using %s", kernel.instead)
    return None


def _made_by(
    compiler: Compiler, kernel: Kernel[object], folder: Path, cache: KernelCache
) -> Path | None:
    """A library that stands its trial; None from a compiler that is broken, which is noted."""
    try:
        library = compiler.compile(kernel.source, folder)
        if _stands_trial(kernel, library):
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
        "%s cannot compile a kernel (%s); another compiler, or else %s, takes its place",
        compiler,
        reason,
        kernel.instead,
    )
    _FAILED.add(compiler)
    return None


def _stands_trial(kernel: Kernel[object], library: Path) -> bool:
    """Whether it is what it should be, tried in another process, which it may kill."""
    imports = os.pathsep.join(filter(os.path.isabs, sys.path))  # what is found here, is found there
    environment = {**os.environ, "PYTHONPATH": imports}
    try:
        run_within(TRIAL_S, kernel.trial(library), library.parent, environment)
    except subprocess.SubprocessError:
        return False
    return True


def _source(functions: Sequence[ca.Function]) -> str:
    generator = ca.CodeGenerator("kernel")
    for function in functions:
        generator.add(function)
    return str(generator.dump())
