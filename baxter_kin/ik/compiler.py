"""CasADi functions as machine code, where a C compiler is found; never required.

A compiler is one on PATH, or else the Python package `ziglang`, which holds one. The C that CasADi
generates is compiled once and kept in the user's cache directory (`$XDG_CACHE_HOME` or `~/.cache`,
folder `baxter-kin`), under a name that is a hash of the functions themselves, so another model,
version or compiler gets another file. A library is loaded only when its checksum is right: loading
a truncated one would kill the interpreter. Whatever goes wrong, the answer is None and the virtual
machine does the work.
"""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import casadi as ca
import numpy as np

from baxter_kin.errors import FileError
from baxter_kin.files import replace_file

COMPILERS = ("cc", "gcc", "clang")
"""Names on PATH, the first one found is taken."""

ZIG = (sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline", "-g0")
"""Clang as the package `ziglang` brings it. By itself it would compile for this processor only."""

FLAGS = ("-O2", "-fPIC", "-shared", "-ffp-contract=off")
"""Nothing tied to one processor, for home folders are shared between machines; strict IEEE."""

TIMEOUT_S = 180.0
"""`cc` takes 1 to 3 s for an arm, `ziglang` 10 to 17 s and once 9 s for its own library."""

AGREEMENT = 1e-9
"""How far machine code may be from the virtual machine on `_PROBES` random inputs. Over 2,000
searches both gave the same bits."""

_PROBES = 5

log = logging.getLogger(__name__)


def compiled(functions: Sequence[ca.Function]) -> tuple[ca.Function, ...] | None:
    """The same functions as machine code; None without a compiler or when anything fails."""
    compiler = compiler_command()
    if compiler is None:
        log.info("no C compiler found; using CasADi's virtual machine")
        return None
    try:
        library = _cached_library(functions, compiler)
        externals = tuple(ca.external(function.name(), str(library)) for function in functions)
    except (OSError, FileError, RuntimeError, subprocess.SubprocessError) as cause:
        log.warning("cannot compile the IK kernel (%s); using CasADi's virtual machine", cause)
        return None
    if not all(map(_agree, functions, externals)):
        log.warning("the compiled IK kernel computes something else; using the virtual machine")
        return None
    return externals


def compiler_command() -> tuple[str, ...] | None:
    """How a C compiler is called here; None where there is none."""
    on_path = next(filter(None, map(shutil.which, COMPILERS)), None)
    if on_path is not None:
        return (on_path,)
    return ZIG if find_spec("ziglang") is not None else None


def cache_folder() -> Path:
    """Where compiled kernels are kept."""
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "baxter-kin"


def _cached_library(functions: Sequence[ca.Function], compiler: Sequence[str]) -> Path:
    library = cache_folder() / f"{_key(functions, compiler)}.so"
    if not _is_intact(library):
        library.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        _compile_into(library, functions, compiler)
    return library


def _key(functions: Sequence[ca.Function], compiler: Sequence[str]) -> str:
    """A hash of all that the machine code depends on."""
    machine = (platform.system(), platform.machine())
    texts = (function.serialize() for function in functions)
    parts = (*texts, version("casadi"), *compiler, *FLAGS, *machine)
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


def _is_intact(library: Path) -> bool:
    try:
        return _checksum(library.read_bytes()) == _checksum_file(library).read_text("ascii")
    except (OSError, UnicodeDecodeError):
        return False


def _compile_into(library: Path, functions: Sequence[ca.Function], compiler: Sequence[str]) -> None:
    """Compile beside the target, then put in place: checksum first, library second."""
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        source, output = Path(folder) / "kernel.c", Path(folder) / "kernel.so"
        source.write_text(_source(functions), "ascii")
        command = [*compiler, *FLAGS, str(source), "-o", str(output), "-lm"]
        subprocess.run(command, check=True, capture_output=True, timeout=TIMEOUT_S)
        machine_code = output.read_bytes()
    replace_file(_checksum_file(library), _checksum(machine_code).encode())
    replace_file(library, machine_code)


def _source(functions: Sequence[ca.Function]) -> str:
    generator = ca.CodeGenerator("kernel")
    for function in functions:
        generator.add(function)
    return str(generator.dump())


def _checksum(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _checksum_file(library: Path) -> Path:
    return library.with_suffix(".sha256")


def _agree(function: ca.Function, external: ca.Function) -> bool:
    """Whether both give the same on random inputs, shapes included."""
    shapes = [function.size_in(i) for i in range(function.n_in())]
    if shapes != [external.size_in(i) for i in range(external.n_in())]:
        return False
    rng = np.random.default_rng(0)
    for _ in range(_PROBES):
        inputs = [rng.uniform(-1.0, 1.0, shape) for shape in shapes]
        for expected, found in zip(function(*inputs), external(*inputs), strict=True):
            difference = np.abs(np.array(expected) - np.array(found))
            if not (difference <= AGREEMENT).all():
                return False
    return True
