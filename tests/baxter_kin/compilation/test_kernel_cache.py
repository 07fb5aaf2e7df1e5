from __future__ import annotations

import logging
import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import pytest

from baxter_kin.compilation.compiler import Compiler
from baxter_kin.compilation.kernel_cache import (
    ABANDONED_AFTER_S,
    MAX_LIBRARIES,
    KernelCache,
    kernel_caches,
    private_folder,
    user_folder,
)
from baxter_kin.errors import FileError


@pytest.fixture(autouse=True)
def new_process() -> None:
    """Forget the folder of this process."""
    private_folder.cache_clear()


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> KernelCache:
    """The user's cache, empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return next(kernel_caches())


def keep(cache: KernelCache, key: str, content: bytes = b"content") -> Path:
    with tempfile.TemporaryDirectory(dir=cache.folder) as folder:
        built = Path(folder) / "kernel.so"
        built.write_bytes(content)
        return cache.keep(key, built)


def test_the_folder_follows_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert user_folder() == tmp_path / ".cache" / "baxter-kin"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "other"))
    assert user_folder() == tmp_path / "other" / "baxter-kin"


@pytest.mark.parametrize("relative", ["", "cache", "./cache", "~/cache"])
def test_a_relative_cache_folder_is_ignored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, relative: str
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", relative)
    assert user_folder() == tmp_path / ".cache" / "baxter-kin"


@pytest.mark.parametrize("home", ["", "home"])
def test_without_a_home_the_folder_is_private(monkeypatch: pytest.MonkeyPatch, home: str) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", home)
    with pytest.raises(FileError, match="HOME is no absolute path"):
        user_folder()
    (cache,) = kernel_caches()
    assert not cache.is_lasting


def test_a_user_whom_the_system_does_not_know_has_a_private_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    (cache,) = kernel_caches()
    assert not cache.is_lasting


def test_the_users_folder_is_made_for_the_user_alone(cache: KernelCache, tmp_path: Path) -> None:
    assert cache == KernelCache(tmp_path / "baxter-kin", is_lasting=True)
    assert cache.folder.stat().st_mode & 0o777 == 0o700


def test_writable_folder_is_reported_once(
    cache: KernelCache, caplog: pytest.LogCaptureFixture
) -> None:
    cache.folder.chmod(0o777)
    first, second = (list(kernel_caches()) for _ in range(2))
    assert first == second
    assert not first[0].is_lasting
    assert first[0].folder.stat().st_mode & 0o777 == 0o700
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert caplog.messages == [
        f"cannot use {cache.folder}: other users may write to it (mode 0777; chmod go-w closes it);"
        " compiled kernels are kept for this process only"
    ]


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722, 0o1777])
def test_a_folder_that_others_may_write_to_is_not_used(cache: KernelCache, mode: int) -> None:
    cache.folder.chmod(mode)
    assert [each.is_lasting for each in kernel_caches()] == [False]


def test_a_folder_of_another_user_is_not_used(
    cache: KernelCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    owner = cache.folder.stat().st_uid
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    with pytest.raises(FileError, match=f"it belongs to another user .number {owner}"):
        list(kernel_caches())  # the private one seems to be another's, too


def test_root_makes_no_folder_in_the_home_of_a_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The user could not use the folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home" / ".cache"))
    real_stat = Path.stat

    def stat_of_another(path: Path, **options: bool) -> os.stat_result:
        status = real_stat(path, **options)
        return os.stat_result([*status[:4], 54_321, *status[5:]]) if path == tmp_path else status

    monkeypatch.setattr(Path, "stat", stat_of_another)
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    with suppress(FileError):  # of the private one, where the tests do not run as root
        assert [each.is_lasting for each in kernel_caches()] == [False]
    assert not (tmp_path / "home").exists()


@pytest.mark.parametrize("what", ["link", "dangling link", "file", "below a file"])
def test_other_files_are_not_used_as_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    if what == "below a file":
        (tmp_path / "cache").write_text("a file")
    else:
        (tmp_path / "cache").mkdir()
        if what == "link":
            (tmp_path / "elsewhere").mkdir(0o700)
        if what == "file":
            (tmp_path / "cache" / "baxter-kin").write_text("a file")
        else:
            (tmp_path / "cache" / "baxter-kin").symlink_to(tmp_path / "elsewhere")
    assert [each.is_lasting for each in kernel_caches()] == [False]
    assert (tmp_path / "elsewhere").exists() == (what == "link")


def test_where_a_system_does_not_know_owners_nothing_is_kept(
    cache: KernelCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "geteuid")
    with pytest.raises(FileError, match="does not know its owner"):
        list(kernel_caches())


def test_the_private_folder_is_gone_when_its_process_is_but_outlives_forks(
    tmp_path: Path,
) -> None:
    program = (
        "import os, sys; from baxter_kin.compilation.kernel_cache import private_folder\n"
        "folder = private_folder()\n"
        "if os.fork() == 0: sys.exit()\n"
        "os.wait()\n"
        "assert folder.stat().st_mode & 0o777 == 0o700\n"
        "print(folder)"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    command = sys.executable, "-W", "ignore", "-c", program
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert Path(done.stdout.strip()).parent == tmp_path.resolve()
    assert list(tmp_path.iterdir()) == []


def test_a_private_folder_that_was_tidied_away_is_made_again(
    cache: KernelCache,
) -> None:
    cache.folder.chmod(0o777)
    (private,) = kernel_caches()
    private.folder.rmdir()
    assert list(kernel_caches()) == [private]
    assert private.folder.stat().st_mode & 0o777 == 0o700


def test_kept_libraries_are_found(cache: KernelCache) -> None:
    library = keep(cache, "key")
    assert cache.library("key") == library
    assert library.read_bytes() == b"content"
    assert cache.library("other") is None


def test_kept_library_replaces_the_one_before(cache: KernelCache) -> None:
    keep(cache, "key", b"old")
    assert keep(cache, "key", b"new").read_bytes() == b"new"
    assert cache.library("key") is not None


@pytest.mark.parametrize("content", [b"", b"conten", b"other content"])
def test_a_damaged_library_is_not_taken_and_removed(cache: KernelCache, content: bytes) -> None:
    library = keep(cache, "key")
    library.write_bytes(content)
    assert cache.library("key") is None
    assert not library.exists()


def test_the_newest_libraries_are_kept(cache: KernelCache) -> None:
    for number in range(MAX_LIBRARIES + 3):
        os.utime(keep(cache, f"{number}"), ns=(number, number))
    kept = {f"{number}" for number in range(3, MAX_LIBRARIES + 3)}
    assert {path.stem.split("-")[0] for path in cache.folder.glob("*.so")} == kept


def test_a_new_library_is_kept_when_the_others_are_from_the_future(cache: KernelCache) -> None:
    future = time.time() + 1e6
    for number in range(MAX_LIBRARIES):
        os.utime(keep(cache, f"{number}"), (future, future))
    assert keep(cache, "new").exists()
    assert len(list(cache.folder.glob("*.so"))) == MAX_LIBRARIES


def test_no_more_notes_than_libraries_are_kept(cache: KernelCache) -> None:
    for number in range(MAX_LIBRARIES + 3):
        (cache.folder / f"{number}.note").touch()
    keep(cache, "key")
    assert len(list(cache.folder.glob("*.note"))) < MAX_LIBRARIES


def test_abandoned_builds_are_removed_after_a_day(cache: KernelCache) -> None:
    old, recent = cache.folder / "build-old", cache.folder / "build-recent"
    for folder in old, recent:
        folder.mkdir()
        (folder / "kernel.c").touch()
    long_ago = time.time() - ABANDONED_AFTER_S - 1.0
    os.utime(old, (long_ago, long_ago))
    keep(cache, "key")
    assert recent.exists()
    assert not old.exists()


def test_a_note_is_for_later_processes(cache: KernelCache, tmp_path: Path) -> None:
    compiler = Compiler(("cc",), tmp_path, 1.0)
    assert not cache.note(compiler).exists()
    cache.note(compiler).write_text("a reason")
    assert next(kernel_caches()).note(compiler).exists()
