"""Files put in place. Devices are made for the tests; the system's own are never touched."""

from __future__ import annotations

import errno
import os
import socket
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from baxter_kin.errors import FileError
from baxter_kin.files import MAX_LINKS, Destination, open_to_read, open_to_write, replace_file

NULL_DEVICE = os.makedev(1, 3)
SOMEBODY = 12345

is_root = os.geteuid() == 0


def write_piecewise(path: Path) -> None:
    with open_to_write(path) as stream:
        stream.write(b"new")


def write_at_once(path: Path) -> None:
    replace_file(path, b"new")


WRITERS = [write_at_once, write_piecewise]


@pytest.fixture(params=WRITERS, ids=lambda writer: writer.__name__)
def write(request: pytest.FixtureRequest) -> Callable[[Path], None]:
    """Either way to write "new"."""
    writer: Callable[[Path], None] = request.param
    return writer


def make_device(path: Path) -> None:
    try:
        os.mknod(path, stat.S_IFCHR | 0o666, NULL_DEVICE)
    except PermissionError:
        pytest.skip("only root may make devices, and the system's own are not for tests")


def make_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))


IRREGULAR = {
    "a device": make_device,
    "a pipe": os.mkfifo,
    "a socket": make_socket,
    "a folder": os.mkdir,
}


@pytest.mark.parametrize("kind", IRREGULAR)
def test_what_is_no_regular_file_is_refused_and_stays(
    tmp_path: Path, write: Callable[[Path], None], kind: str
) -> None:
    """As root, `save_plan(plan, "/dev/null")` once replaced the device by a file."""
    IRREGULAR[kind](path := tmp_path / "it")
    (tmp_path / "link").symlink_to("it")
    before = path.stat()
    for given in (path, tmp_path / "link"):
        with pytest.raises(FileError, match=f"it is {kind}, not a regular file"):
            write(given)
    with pytest.raises(FileError):  # without waiting for another process
        open_to_read(path)
    after = path.stat()
    assert (after.st_mode, after.st_ino, after.st_rdev) == (
        before.st_mode,
        before.st_ino,
        before.st_rdev,
    )
    assert sorted(os.listdir(tmp_path)) == ["it", "link"]
    assert (tmp_path / "link").is_symlink()


def test_what_is_written_is_read(tmp_path: Path, write: Callable[[Path], None]) -> None:
    (tmp_path / "file").write_bytes(b"much longer than what is new")
    for name in ("file", "another"):
        write(tmp_path / name)
        with open_to_read(str(tmp_path / name)) as stream:
            assert stream.read() == b"new"
    assert sorted(os.listdir(tmp_path)) == ["another", "file"]


def test_links_stay_links_and_what_they_lead_to_is_written(
    tmp_path: Path, write: Callable[[Path], None]
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "first").symlink_to(Path("folder", "second"))
    (tmp_path / "folder" / "second").symlink_to(Path("..", "file"))
    for _ in ("the file is made", "the file is replaced"):
        write(tmp_path / "first")
        assert (tmp_path / "first").is_symlink()
        assert (tmp_path / "folder" / "second").is_symlink()
        assert (tmp_path / "file").read_bytes() == b"new"


@pytest.mark.parametrize("length", [1, 2, MAX_LINKS + 2])
def test_links_that_lead_nowhere_are_one_sentence(
    tmp_path: Path, write: Callable[[Path], None], length: int
) -> None:
    for number in range(length):
        (tmp_path / f"{number}").symlink_to(f"{(number + 1) % length}")
    with pytest.raises(FileError, match="its symbolic links form a loop"):
        write(tmp_path / "0")
    with pytest.raises(FileError, match=r"cannot read .*: its symbolic links form a loop"):
        open_to_read(tmp_path / "0")


@pytest.mark.parametrize("mode", [0o600, 0o755])
def test_permissions_of_a_replaced_file_are_kept(
    tmp_path: Path, write: Callable[[Path], None], mode: int
) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    path.chmod(mode)
    write(path)
    assert stat.S_IMODE(path.stat().st_mode) == mode


def test_a_new_file_gets_what_the_umask_leaves(
    tmp_path: Path, write: Callable[[Path], None]
) -> None:
    before = os.umask(0o027)
    try:
        write(tmp_path / "file")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o640


def test_the_owner_of_a_replaced_file_is_kept_where_the_system_allows(
    tmp_path: Path, write: Callable[[Path], None]
) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    owner = SOMEBODY if is_root else os.geteuid()
    os.chown(path, owner, -1)
    write(path)
    assert path.stat().st_uid == owner


def test_a_file_of_another_owner_is_replaced_where_the_system_keeps_the_owner_to_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, "fchown", refuse)
    (tmp_path / "file").write_bytes(b"old")
    replace_file(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"new"


def test_a_write_protected_file_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its folder would allow it; to root nothing is protected, so the answer is the test's own."""
    (tmp_path / "file").write_bytes(b"old")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(FileError, match="Permission denied"):
        replace_file(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"old"


@pytest.mark.parametrize("fails", ["replace", "fsync"])
def test_a_failed_write_keeps_the_old_file_and_leaves_nothing_beside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: str
) -> None:
    def fail(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    (tmp_path / "file").write_bytes(b"old")
    monkeypatch.setattr(os, fails, fail)
    with pytest.raises(FileError, match="No space left on device"):
        replace_file(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["file"]


def test_a_name_may_be_as_long_as_the_system_takes(
    tmp_path: Path, write: Callable[[Path], None]
) -> None:
    write(tmp_path / (255 * "x"))
    assert os.listdir(tmp_path) == [255 * "x"]


@pytest.mark.parametrize(
    "path", ["missing/file", "a\0b", "x" * 5000, "", None, b"file"], ids=lambda path: str(path)[:9]
)
def test_paths_that_lead_nowhere_are_told_with_the_reason(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    write: Callable[[Path], None],
    path: Any,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileError) as caught:
        write(path)
    assert (caught.value.action, caught.value.path) == ("write", path)
    assert caught.value.reason


def test_all_names_of_a_file_have_one_identity(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("file")
    (tmp_path / "folder").symlink_to(".")
    paths = [tmp_path / "file", tmp_path / "link", tmp_path / "folder" / "file"]
    assert len({Destination.of(path).identity for path in paths}) == 1
    (tmp_path / "file").write_bytes(b"")
    (tmp_path / "hard").hardlink_to(tmp_path / "file")
    paths.append(tmp_path / "hard")
    assert len({Destination.of(path).identity for path in paths}) == 1
    assert Destination.of(tmp_path / "other").identity != Destination.of(paths[0]).identity
