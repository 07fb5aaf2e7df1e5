"""The public names, and what importing them may cost."""

from __future__ import annotations

import ast
import subprocess
import sys
import types
from importlib import import_module
from pathlib import Path

import pytest

import baxter_kin
import baxter_kin.ik
from tests.front_doors import DOCUMENTED, LAZY

QUIET_IMPORT = """
import socket, sys, threading
opened = []
def audit(event, args):
    if event == "open" and not str(args[0]).endswith((".py", ".pyc")):
        opened.append(str(args[0]))
    if event in ("socket.bind", "subprocess.Popen"):
        opened.append(event)
before = set(sys.modules)
sys.addaudithook(audit)
import baxter_kin
print(opened, threading.active_count(), "pinocchio" in sys.modules)
"""

MESHES_READ = """
import sys
opened = []
def audit(event, args):
    if event == "open":
        opened.append(str(args[0]).lower())
from baxter_kin import Baxter
import pinocchio
def refuse(*args, **kwargs):
    raise AssertionError("geometry was read")
pinocchio.buildGeomFromUrdf = pinocchio.buildModelsFromUrdf = refuse
sys.addaudithook(audit)
Baxter.load()
print([path for path in opened if path.endswith((".dae", ".stl", ".obj"))])
"""


@pytest.mark.parametrize("package", DOCUMENTED, ids=lambda package: package.__name__)
def test_all_lists_what_exists_in_order(package: types.ModuleType) -> None:
    assert list(package.__all__) == sorted(package.__all__)
    assert all(getattr(package, name) is not None for name in package.__all__)


@pytest.mark.parametrize("package", LAZY, ids=lambda package: package.__name__)
def test_names_that_load_later_are_those_that_type_checkers_see(package: types.ModuleType) -> None:
    tree = ast.parse(Path(str(package.__file__)).read_text(encoding="utf-8"))
    (told,) = (node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in told.body if isinstance(node, ast.ImportFrom)]
    seen = {name.name: node.module for node in imports for name in node.names}
    assert set(seen) == set(package.__all__)
    for name, module in seen.items():
        assert getattr(package, name) is getattr(import_module(str(module)), name)


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Sawyer'"):
        _ = baxter_kin.Sawyer


def test_import_reads_no_file_and_starts_nothing() -> None:
    assert _output_of(QUIET_IMPORT) == "[] 1 False"


def test_load_reads_no_mesh() -> None:
    assert _output_of(MESHES_READ) == "[]"


def _output_of(program: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()
