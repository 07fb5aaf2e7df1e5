from __future__ import annotations

from pathlib import Path

import pytest

from baxter_kin import Baxter, DescriptionError
from baxter_kin.description import RobotDescription


def test_finds_the_installed_files() -> None:
    files = RobotDescription.installed()
    assert files.urdf.is_file()
    assert files.srdf.is_file()


def test_package_folder_resolves_mesh_paths() -> None:
    files = RobotDescription.installed()
    mesh = "example-robot-data/robots/baxter_description/meshes/head/H0.DAE"
    assert (files.package_dir / mesh).is_file()


def test_missing_file_is_named(tmp_path: Path) -> None:
    nowhere = tmp_path / "baxter.urdf"
    with pytest.raises(DescriptionError, match=r"lacks .*baxter\.urdf"):
        RobotDescription(urdf=nowhere, srdf=nowhere, package_dir=tmp_path)


@pytest.mark.parametrize(
    ("urdf", "reason"),
    [
        ("<robot name='x'><link name='base'/></robot>", "lacks the joints"),
        ("this is no XML", "cannot read"),
    ],
)
def test_another_urdf_is_refused(tmp_path: Path, urdf: str, reason: str) -> None:
    path = tmp_path / "other.urdf"
    path.write_text(urdf)
    with pytest.raises(DescriptionError, match=reason):
        Baxter.load(RobotDescription(urdf=path, srdf=path, package_dir=tmp_path))
