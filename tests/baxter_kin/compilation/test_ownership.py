from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from baxter_kin.compilation.ownership import make_own_folder, read_own_file
from baxter_kin.errors import FileError

Give = Callable[[Path, int], None]


@pytest.fixture
def give(monkeypatch: pytest.MonkeyPatch) -> Give:
    """Let a file seem to belong to another user, for this module and whoever else asks."""
    owners: dict[tuple[int, int], int] = {}

    def as_given(status: os.stat_result) -> os.stat_result:
        owner = owners.get((status.st_dev, status.st_ino), status.st_uid)
        return os.stat_result([*status[:4], owner, *status[5:]])

    def give_to(path: Path, owner: int) -> None:
        status = real_lstat(path)
        owners[status.st_dev, status.st_ino] = owner

    real_lstat, real_fstat = os.lstat, os.fstat
    monkeypatch.setattr(os, "lstat", lambda path: as_given(real_lstat(path)))
    monkeypatch.setattr(os, "fstat", lambda descriptor: as_given(real_fstat(descriptor)))
    return give_to


STRANGER = 54_321


def test_a_folder_is_made_for_this_user_alone(tmp_path: Path) -> None:
    folder = make_own_folder(tmp_path / "a" / "b")
    assert folder == (tmp_path / "a" / "b").resolve()
    for made in folder, folder.parent:
        assert made.stat().st_mode & 0o777 == 0o700


def test_a_folder_that_is_there_stays_as_it_is(tmp_path: Path) -> None:
    folder = tmp_path / "own"
    folder.mkdir(0o755)
    assert make_own_folder(folder) == folder.resolve()
    assert folder.stat().st_mode & 0o777 == 0o755


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722, 0o1777])
def test_refuses_a_folder_that_others_may_write_to(tmp_path: Path, mode: int) -> None:
    folder = tmp_path / "own"
    folder.mkdir()
    folder.chmod(mode)
    with pytest.raises(FileError, match=f"other users may write to it .mode {mode:04o}"):
        make_own_folder(folder)


def test_refuses_a_folder_of_another_user(tmp_path: Path, give: Give) -> None:
    folder = make_own_folder(tmp_path / "own")
    give(folder, STRANGER)
    with pytest.raises(FileError, match=f"it belongs to another user .number {STRANGER}"):
        make_own_folder(folder)


def test_refuses_a_link_to_a_folder(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir(0o700)
    (tmp_path / "own").symlink_to("elsewhere")
    with pytest.raises(FileError, match="it is a symbolic link"):
        make_own_folder(tmp_path / "own")


def test_refuses_a_dangling_link_and_makes_nothing_of_it(tmp_path: Path) -> None:
    (tmp_path / "own").symlink_to("elsewhere")
    with pytest.raises(FileError, match="it is a symbolic link"):
        make_own_folder(tmp_path / "own")
    assert not (tmp_path / "elsewhere").exists()


def test_follows_links_above_and_names_the_folder_without_them(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir(0o700)
    (tmp_path / "home").symlink_to("disk")
    assert make_own_folder(tmp_path / "home" / "own") == (tmp_path / "disk" / "own").resolve()


def test_refuses_what_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "own").write_text("a file")
    for path in tmp_path / "own", tmp_path / "own" / "below":
        with pytest.raises(FileError, match="it is no folder"):
            make_own_folder(path)


def test_refuses_a_folder_that_others_could_replace(tmp_path: Path) -> None:
    """Whoever may write to the folder above may move this one away."""
    folder = make_own_folder(tmp_path / "open" / "own")
    folder.parent.chmod(0o777)
    with pytest.raises(FileError, match=r"open: other users may write to it .mode 0777"):
        make_own_folder(folder)


def test_makes_nothing_where_others_could_replace_it(tmp_path: Path, give: Give) -> None:
    """Root leaves no folder of its own in the home of a user, who could not use it then."""
    (tmp_path / "home").mkdir(0o755)
    give(tmp_path / "home", STRANGER)
    with pytest.raises(FileError, match="home: it belongs to another user"):
        make_own_folder(tmp_path / "home" / ".cache" / "own")
    assert list((tmp_path / "home").iterdir()) == []


def test_a_sticky_folder_above_is_safe(tmp_path: Path) -> None:
    """Others may add to it, but not move what is there: such is `/tmp`."""
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared").chmod(0o1777)
    assert make_own_folder(tmp_path / "shared" / "own").is_dir()


def test_a_sticky_folder_of_another_user_is_not(tmp_path: Path, give: Give) -> None:
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared").chmod(0o1777)
    give(tmp_path / "shared", STRANGER)
    with pytest.raises(FileError, match="shared: it belongs to another user"):
        make_own_folder(tmp_path / "shared" / "own")


def test_folders_above_may_be_roots(tmp_path: Path, give: Give) -> None:
    (tmp_path / "home").mkdir(0o755)
    give(tmp_path / "home", 0)
    assert make_own_folder(tmp_path / "home" / "own").is_dir()


def test_refuses_where_a_system_does_not_know_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "geteuid")
    with pytest.raises(FileError, match="does not tell whose it is"):
        make_own_folder(tmp_path / "own")


def test_reads_a_file_of_ones_own(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"content")
    (tmp_path / "file").chmod(0o644)  # whatever the umask is
    assert read_own_file(tmp_path / "file") == b"content"


def test_a_file_that_is_not_there_is_an_error_of_the_system(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_own_file(tmp_path / "file")


def test_refuses_a_link_to_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"content")
    (tmp_path / "link").symlink_to("file")
    with pytest.raises(FileError, match="it is a symbolic link"):
        read_own_file(tmp_path / "link")


def test_refuses_a_file_of_another_user(tmp_path: Path, give: Give) -> None:
    (tmp_path / "file").write_bytes(b"content")
    give(tmp_path / "file", STRANGER)
    with pytest.raises(FileError, match="it belongs to another user"):
        read_own_file(tmp_path / "file")


def test_refuses_a_file_that_others_may_write_to(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"content")
    (tmp_path / "file").chmod(0o666)
    with pytest.raises(FileError, match="other users may write to it"):
        read_own_file(tmp_path / "file")


def test_refuses_a_pipe_without_waiting_for_it(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    with pytest.raises(FileError, match="it is no regular file"):
        read_own_file(tmp_path / "pipe")
