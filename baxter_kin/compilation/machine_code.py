"""C as machine code, where a C compiler is found; never required.

C is compiled once and kept under a name that contains a hash of everything it is made from, so that
another model or version gets another file. Compilers are tried in turn, and a library is kept only
if it passes its test in another process (`baxter_kin.compilation.agreement` for CasADi functions).
If anything fails, the result is None and a slower implementation is used: for CasADi functions, its
virtual machine.
"""

from __future__ import annotations

import logging
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Protocol, TypeVar

import casadi as ca

from baxter_kin.compilation import agreement
from baxter_kin.compilation.compiler import FLAGS, Compiler, compilers, run_within
from baxter_kin.compilation.kernel_cache import BUILD, KernelCache, digest, kernel_caches
from baxter_kin.errors import FileError

TEST_S = 60.0
"""Time limit for the test of a library, which usually takes half a second."""

_FAILED: set[Compiler] = set()
"""Compilers that failed in this process; they are not tried again."""

log = logging.getLogger(__name__)


T_co = TypeVar("T_co", covariant=True)


class Kernel(Protocol[T_co]):
    """C source that can be compiled, and how to load the result."""

    @property
    def instead(self) -> str:
        """What is used where it cannot be compiled, as a phrase."""

    @property
    def key(self) -> str:
        """A hash of everything that the machine code depends on, except the compiler."""

    @property
    def source(self) -> str:
        """The C source."""

    def load(self, library: Path) -> T_co | None:
        """The content of a library that has passed its test; None if it does not load."""

    def trial(self, library: Path) -> Sequence[str]:
        """A command whose exit status is 0 if a library contains the kernel and is correct.

        A broken library may kill its process. It may leave files beside the library.
        """


def compiled(
    functions: Sequence[ca.Function],
    alongside: Callable[[], Iterable[Sequence[ca.Function]]] = tuple,
) -> tuple[ca.Function, ...] | None:
    """CasADi functions as machine code; None without a compiler or when anything fails.

    Args:
        functions: the contents of one library.
        alongside: makes the functions of further libraries, which are compiled whenever this one
            has to be, so that nobody waits for them later.
    """
    return built(_Functions(functions), lambda: map(_Functions, alongside()))


def built(
    kernel: Kernel[T_co], alongside: Callable[[], Iterable[Kernel[object]]] = tuple
) -> T_co | None:
    """A kernel as machine code; None without a compiler or when anything fails.

    Args:
        kernel: the C source.
        alongside: makes further kernels, which are compiled whenever this one has to be.
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
                    for each in alongside():
                        if cache.library(each.key) is None:
                            _made(each, cache, found)
            if loaded is not None or cache.is_writable:
                return loaded
    except (OSError, FileError) as cause:
        log.warning("cannot compile a kernel (%s); using %s", cause, kernel.instead)
    return None


def key_of(*parts: str | bytes) -> str:
    """A hash of what a kernel is made from, the compiler's flags and the kind of machine."""
    own = (*parts, *FLAGS, platform.system(), platform.machine())
    texts = (part if isinstance(part, bytes) else part.encode() for part in own)
    return digest(b"\0".join(texts))


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
        generator = ca.CodeGenerator("kernel")
        for function in self.functions:
            generator.add(function)
        return str(generator.dump())

    def load(self, library: Path) -> tuple[ca.Function, ...] | None:
        try:
            return tuple(ca.external(each.name(), str(library)) for each in self.functions)
        except RuntimeError:
            return None

    def trial(self, library: Path) -> Sequence[str]:
        saved = [library.with_name(f"{i}.casadi") for i in range(len(self.functions))]
        for function, path in zip(self.functions, saved, strict=True):
            function.save(str(path))
        return (sys.executable, str(agreement.__file__), str(library), *map(str, saved))


def _made(kernel: Kernel[T_co], cache: KernelCache, found: Sequence[Compiler]) -> T_co | None:
    """The kernel, compiled by the first compiler that works, and kept in the cache."""
    how_often = f"once; kept in {cache.folder}" if cache.is_lasting else "once in this process"
    for compiler in found:
        if compiler in _FAILED:
            continue
        log.info("compiling a kernel with %s: takes some seconds, %s", compiler, how_often)
        with tempfile.TemporaryDirectory(
            prefix=BUILD, dir=cache.folder, ignore_cleanup_errors=True
        ) as folder:
            library = _made_by(compiler, kernel, Path(folder))
            if library is not None:
                return kernel.load(cache.keep(kernel.key, library))
    log.debug("no C compiler works; using %s", kernel.instead)
    return None


def _made_by(compiler: Compiler, kernel: Kernel[object], folder: Path) -> Path | None:
    """A library that passes its test; None if the compiler is broken, which is remembered."""
    try:
        library = compiler.compile(kernel.source, folder)
        if _passes_test(kernel, library):
            return library
        reason = "its output does not load, or computes something else"
    except (OSError, subprocess.SubprocessError) as cause:
        reason = str(cause)
    log.warning(
        "%s cannot compile a kernel (%s); another compiler, or else %s, is used instead",
        compiler,
        reason,
        kernel.instead,
    )
    _FAILED.add(compiler)
    return None


def _passes_test(kernel: Kernel[object], library: Path) -> bool:
    """Whether a library contains the kernel; tested in another process, which it may kill."""
    imports = os.pathsep.join(filter(os.path.isabs, sys.path))  # the same modules are found there
    environment = {**os.environ, "PYTHONPATH": imports}
    try:
        run_within(TEST_S, kernel.trial(library), library.parent, environment)
    except subprocess.SubprocessError:
        return False
    return True
