from __future__ import annotations

import logging
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from baxter_kin.compilation import kernel_cache
from baxter_kin.compilation.kernel_cache import (
    ABANDONED_AFTER_S,
    MOST_LIBRARIES,
    KernelCache,
    PrivateFolder,
    kernel_caches,
    user_folder,
)
from baxter_kin.errors import FileError


@pytest.fixture(autouse=True)
def new_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a process remembers."""
    monkeypatch.setattr(kernel_cache, "_PRIVATE", PrivateFolder())


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> KernelCache:
    """The user's, and empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return next(kernel_caches())


def keep(cache: KernelCache, key: str, content: bytes = b"content") -> Path:
    with cache.workplace() as folder:
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
    def unknown() -> Path:
        raise RuntimeError

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr(Path, "home", unknown)
    (cache,) = kernel_caches()
    assert not cache.is_lasting


def test_the_users_folder_is_made_for_the_user_alone(cache: KernelCache, tmp_path: Path) -> None:
    assert cache == KernelCache(tmp_path.resolve() / "baxter-kin", is_lasting=True)
    assert cache.folder.stat().st_mode & 0o777 == 0o700


def test_what_others_may_write_to_is_not_used_and_told_once(
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


def test_a_linked_folder_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "elsewhere").mkdir(0o700)
    (tmp_path / "baxter-kin").symlink_to("elsewhere")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert [cache.is_lasting for cache in kernel_caches()] == [False]


def test_the_private_folder_is_gone_when_its_process_is_but_outlives_forks(
    tmp_path: Path,
) -> None:
    program = (
        "import os, sys; from baxter_kin.compilation.kernel_cache import PrivateFolder\n"
        "folder = PrivateFolder().opened('no reason')\n"
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


def test_a_private_folder_that_was_tidied_away_is_made_again() -> None:
    private = PrivateFolder()
    folder = private.opened("no reason")
    folder.rmdir()
    assert private.opened("no reason") == folder
    assert folder.stat().st_mode & 0o777 == 0o700


def test_nothing_is_private_where_others_could_replace_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tmp_path.chmod(0o777)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(FileError, match="other users may write to it"):
        PrivateFolder().opened("no reason")


def test_what_is_kept_is_found(cache: KernelCache) -> None:
    library = keep(cache, "key")
    assert cache.library("key") == library
    assert library.read_bytes() == b"content"
    assert cache.library("other") is None


def test_what_is_kept_takes_the_place_of_what_was_there(cache: KernelCache) -> None:
    keep(cache, "key", b"old")
    assert keep(cache, "key", b"new").read_bytes() == b"new"
    assert cache.library("key") is not None


@pytest.mark.parametrize("suffix", [".so", ".sha256"])
def test_a_linked_file_is_not_taken(
    cache: KernelCache, tmp_path: Path, suffix: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = keep(cache, "key").with_suffix(suffix)
    path.symlink_to(path.rename(tmp_path / "elsewhere"))
    assert cache.library("key") is None
    assert "it is a symbolic link" in caplog.text


@pytest.mark.parametrize("suffix", [".so", ".sha256"])
def test_a_file_that_others_may_write_to_is_not_taken(cache: KernelCache, suffix: str) -> None:
    keep(cache, "key").with_suffix(suffix).chmod(0o666)
    assert cache.library("key") is None


def test_a_file_of_another_user_is_not_taken(
    cache: KernelCache, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    owner = keep(cache, "key").stat().st_uid
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    assert cache.library("key") is None
    assert f"it belongs to another user (number {owner})" in caplog.text


def test_the_newest_libraries_are_kept(cache: KernelCache) -> None:
    for number in range(MOST_LIBRARIES + 3):
        os.utime(keep(cache, f"{number}"), ns=(number, number))
    kept = {f"{number}" for number in range(3, MOST_LIBRARIES + 3)}
    assert {path.stem for path in cache.folder.glob("*.so")} == kept
    assert {path.stem for path in cache.folder.glob("*.sha256")} == kept


def test_a_new_library_is_kept_when_the_others_are_from_the_future(cache: KernelCache) -> None:
    future = time.time() + 1e6
    for number in range(MOST_LIBRARIES):
        os.utime(keep(cache, f"{number}"), (future, future))
    assert keep(cache, "new").exists()
    assert len(list(cache.folder.glob("*.so"))) == MOST_LIBRARIES


def test_no_more_notes_than_libraries_are_kept(cache: KernelCache) -> None:
    for number in range(MOST_LIBRARIES + 3):
        cache.note(f"{number}", "a reason")
    keep(cache, "key")
    assert len(list(cache.folder.glob("*.note"))) < MOST_LIBRARIES


def test_what_a_killed_process_left_is_removed_after_a_day(cache: KernelCache) -> None:
    old, recent = cache.folder / "build-old", cache.folder / "build-recent"
    for folder in old, recent:
        folder.mkdir()
        (folder / "kernel.c").touch()
    long_ago = time.time() - ABANDONED_AFTER_S - 1.0
    os.utime(old, (long_ago, long_ago))
    keep(cache, "key")
    assert recent.exists()
    assert not old.exists()


def test_a_note_is_for_later_processes(cache: KernelCache) -> None:
    assert not cache.has_note("name")
    cache.note("name", "a reason")
    assert next(kernel_caches()).has_note("name")
