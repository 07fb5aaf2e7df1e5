"""C as machine code, where a C compiler is found; never required.

C is compiled once and kept under a name that contains a hash of everything it is made from, so that
another model or version gets another file. Compilers are tried in turn, and a library is kept only
if it passes its test in another process (`baxter_kin.compilation.agreement` for CasADi functions).
If anything fails, the result is None and a slower implementation is used: for CasADi functions, its
virtual machine.

Libraries are machine code that runs with this user's rights. They are loaded only from a folder
that belongs to this user and that nobody else may write to: `baxter-kin` in `$XDG_CACHE_HOME` or
`~/.cache`, made with mode 0700, or else a temporary one of this process. A checksum in the name of
a library guards against damage: loading a truncated library would kill the interpreter.
"""

from __future__ import annotations

import atexit
import hashlib
import logging
import os
import platform
import shutil
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Protocol, TypeVar

import casadi as ca

from baxter_kin.compilation import agreement
from baxter_kin.compilation.compiler import FLAGS, Compiler, compilers, run_within
from baxter_kin.errors import FileError

TEST_S = 60.0
"""Time limit for the test of a library, which usually takes half a second."""

MAX_LIBRARIES = 16
"""How many libraries are kept, the newest ones: those of both arms in four versions of model or
toolkit. As many notes about compilers are kept."""

ABANDONED_AFTER_S = 86_400.0
"""Age from which unfinished builds, left by a killed process, are removed."""

_BUILD = "build-"

_NAMING = "2"
"""Version of the rule by which libraries are named; others are never looked up."""

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
    own = (_NAMING, *parts, *FLAGS, platform.system(), platform.machine())
    texts = (part if isinstance(part, bytes) else part.encode() for part in own)
    return _digest(b"\0".join(texts))


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


# Compilation


def _made(kernel: Kernel[T_co], cache: KernelCache, found: Sequence[Compiler]) -> T_co | None:
    """The kernel, compiled by the first compiler that works, and kept in the cache."""
    how_often = f"once; kept in {cache.folder}" if cache.is_lasting else "once in this process"
    for compiler in found:
        if compiler in _FAILED or cache.note(compiler).exists():
            continue
        log.info("compiling a kernel with %s: takes some seconds, %s", compiler, how_often)
        with tempfile.TemporaryDirectory(
            prefix=_BUILD, dir=cache.folder, ignore_cleanup_errors=True
        ) as folder:
            library = _made_by(compiler, kernel, Path(folder), cache)
            if library is not None:
                return kernel.load(cache.keep(kernel.key, library))
    log.debug("no C compiler works; using %s", kernel.instead)
    return None


def _made_by(
    compiler: Compiler, kernel: Kernel[object], folder: Path, cache: KernelCache
) -> Path | None:
    """A library that passes its test; None if the compiler is broken, which is remembered."""
    try:
        library = compiler.compile(kernel.source, folder)
        if _passes_test(kernel, library):
            return library
        reason = "its output does not load, or computes something else"
    except subprocess.TimeoutExpired as cause:
        reason = f"no answer within {cause.timeout:g} s; not tried again until it changes"
        cache.note(compiler).write_text(f"{compiler}: {reason}\n", "utf-8")
    except subprocess.CalledProcessError as cause:
        reason = f"exit status {cause.returncode}"
    except OSError as cause:
        reason = cause.strerror or str(cause)
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


# Where libraries are kept


@dataclass(frozen=True, slots=True)
class KernelCache:
    """A folder with libraries that belongs to this user alone.

    Attributes:
        folder: absolute.
        is_lasting: whether it outlives this process.
    """

    folder: Path
    is_lasting: bool

    @property
    def is_writable(self) -> bool:
        """Whether libraries can be added."""
        return os.access(self.folder, os.W_OK | os.X_OK)

    def library(self, key: str) -> Path | None:
        """The library of a kernel; None unless it is there and intact. A damaged one is removed."""
        for path in self.folder.glob(f"{key}-*.so"):
            with suppress(OSError):
                if path.name == _name(key, path.read_bytes()):
                    return path
                path.unlink()
        return None

    def keep(self, key: str, built: Path) -> Path:
        """Move a library that was built inside the folder into place, and remove the oldest."""
        library = self.folder / _name(key, built.read_bytes())
        built.chmod(0o600)
        os.replace(built, library)
        with suppress(OSError):  # as when another process removes the same
            self._remove_oldest(library)
        return library

    def note(self, compiler: Compiler) -> Path:
        """The file that records that a compiler hangs."""
        return self.folder / f"{compiler.version_key}.note"

    def _remove_oldest(self, newest: Path) -> None:
        for pattern in "*.so", "*.note":
            others = [path for path in self.folder.glob(pattern) if path != newest]
            others.sort(key=lambda path: path.lstat().st_mtime_ns, reverse=True)
            for path in others[MAX_LIBRARIES - 1 :]:
                path.unlink()
        for build in self.folder.glob(f"{_BUILD}*"):
            if build.lstat().st_mtime < time.time() - ABANDONED_AFTER_S:
                shutil.rmtree(build, ignore_errors=True)


def kernel_caches() -> Iterator[KernelCache]:
    """Caches in the order in which they are searched; the first writable one takes new libraries.

    The first is the user's folder, if it belongs to this user alone; the second belongs to this
    process and is made when it is first needed.
    """
    try:
        user = KernelCache(_own(user_folder()), is_lasting=True)
    except FileError as cause:
        reason = str(cause)
    else:
        yield user
        reason = f"cannot write to {user.folder}"
    if not private_folder.cache_info().currsize:
        log.warning("%s; compiled kernels are kept for this process only", reason)
    yield KernelCache(_own(private_folder()), is_lasting=False)


def user_folder() -> Path:
    """The user's cache folder.

    A relative `XDG_CACHE_HOME` is ignored, as the XDG Base Directory Specification requires. An
    empty `HOME` is refused with a `FileError`.
    """
    cache = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(cache):
        return Path(cache, "baxter-kin")
    home = os.path.expanduser("~")
    if not os.path.isabs(home) or not os.environ.get("HOME", home):
        raise FileError("use", "~/.cache/baxter-kin", "HOME is no absolute path")
    return Path(home, ".cache", "baxter-kin")


@lru_cache(maxsize=1)
def private_folder() -> Path:
    """A temporary folder, removed when this process ends."""
    folder = Path(tempfile.mkdtemp(prefix="baxter-kin-"))
    atexit.register(_remove, folder, os.getpid())
    return folder


def _remove(folder: Path, owner: int) -> None:
    """Remove a folder at the end of the process that made it, but not of its forks."""
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)


def _own(folder: Path) -> Path:
    """A folder that belongs to this user and that nobody else may write to; made if missing.

    Any other folder is refused with a `FileError`.
    """
    if not hasattr(os, "geteuid"):
        raise FileError("use", folder, "this system does not know its owner")
    try:
        above = next(path for path in folder.parents if path.exists())
        if not folder.exists() and os.geteuid() == 0 and above.stat().st_uid != 0:
            raise FileError("use", folder, f"{above} belongs to another user, not to root")
        folder.parent.mkdir(0o700, parents=True, exist_ok=True)
        with suppress(FileExistsError):
            folder.mkdir(0o700)
        status = folder.lstat()
    except OSError as cause:
        raise FileError("use", folder, cause.strerror or str(cause)) from cause
    if not stat.S_ISDIR(status.st_mode):
        raise FileError("use", folder, "it is a link or no folder")
    if status.st_uid != os.geteuid():
        raise FileError("use", folder, f"it belongs to another user (number {status.st_uid})")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        mode = stat.S_IMODE(status.st_mode)
        raise FileError(
            "use", folder, f"other users may write to it (mode {mode:04o}; chmod go-w closes it)"
        )
    return folder


def _name(key: str, content: bytes) -> str:
    """The file name of a library; a library under the name of another kernel counts as damaged."""
    return f"{key}-{_digest(key.encode() + content)}.so"


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]
