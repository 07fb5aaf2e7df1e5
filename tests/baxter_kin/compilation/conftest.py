"""What the tests of compilers share: shell scripts as compilers, and libraries made once."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import pytest

from baxter_kin.compilation import compiler, machine_code
from baxter_kin.compilation.compiler import compilers
from baxter_kin.compilation.kernel_cache import temporary_folder

Provide = Callable[..., None]
Compile = Callable[[ca.Function], Path]


@pytest.fixture(autouse=True)
def new_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget what a process remembers."""
    monkeypatch.setattr(machine_code, "_FAILED", set())
    temporary_folder.cache_clear()


@pytest.fixture(scope="session")
def compile_once(tmp_path_factory: pytest.TempPathFactory) -> Compile:
    """A library of a function, by the first compiler of this machine."""
    found = compilers()
    if not found:
        pytest.skip("machine code needs a C compiler; pip install ziglang brings one")

    def library(function: ca.Function) -> Path:
        generator = ca.CodeGenerator(function.name())
        generator.add(function)
        return found[0].compile(str(generator.dump()), tmp_path_factory.mktemp("library"))

    return library


@pytest.fixture
def provide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Provide:
    """Install shell scripts as the only compilers; they write to `$output`."""
    folder = tmp_path / "bin"
    folder.mkdir()

    def provided(**scripts: str) -> None:
        for name, script in scripts.items():
            find_output = 'given="$*"; while [ "$1" != -o ]; do shift; done; output=$2'
            (folder / name).write_text(f"#!/bin/sh\n{find_output}\n{script}\n")
            (folder / name).chmod(0o755)
        monkeypatch.setattr(compiler, "COMPILERS", tuple(scripts))
        monkeypatch.setattr(compiler, "find_spec", lambda _: None)
        monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")

    return provided
