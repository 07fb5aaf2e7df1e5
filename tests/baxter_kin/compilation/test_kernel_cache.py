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

from baxter_kin.compilation.kernel_cache import (
    ABANDONED_AFTER_S,
    MAX_LIBRARIES,
    KernelCache,
    kernel_caches,
    user_folder,
)
from baxter_kin.errors import FileError


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


@pytest.mark.parametrize("given", [None, "", "cache", "./cache", "~/cache", "/absolute"])
def test_the_folder_follows_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: str | None
) -> None:
    """A relative one is ignored."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    if given is not None:
        monkeypatch.setenv("XDG_CACHE_HOME", given)
    expected = Path("/absolute") if given == "/absolute" else tmp_path / ".cache"
    assert user_folder() == expected / "baxter-kin"


@pytest.mark.parametrize("home", ["", "home", None])
def test_without_a_home_the_folder_is_temporary(
    monkeypatch: pytest.MonkeyPatch, home: str | None
) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    if home is None:  # of a user whom the system does not know
        monkeypatch.delenv("HOME", raising=False)
        monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    else:
        monkeypatch.setenv("HOME", home)
    with pytest.raises(FileError, match="HOME is no absolute path"):
        user_folder()
    assert [each.is_lasting for each in kernel_caches()] == [False]


def test_the_users_folder_is_made_for_the_user_alone(cache: KernelCache, tmp_path: Path) -> None:
    assert cache == KernelCache(tmp_path / "baxter-kin", is_lasting=True)
    assert cache.folder.stat().st_mode & 0o777 == 0o700
    assert cache.is_writable


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722, 0o1777])
def test_a_folder_that_others_may_write_to_is_not_used_and_reported_once(
    cache: KernelCache, mode: int, caplog: pytest.LogCaptureFixture
) -> None:
    cache.folder.chmod(mode)
    first, second = (list(kernel_caches()) for _ in range(2))
    assert first == second
    assert not first[0].is_lasting
    assert first[0].folder.stat().st_mode & 0o777 == 0o700
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert str(cache.folder) in caplog.text
    first[0].folder.rmdir()  # as a tidying system does
    assert list(kernel_caches()) == first
    assert first[0].folder.stat().st_mode & 0o777 == 0o700


def test_a_folder_of_another_user_is_not_used(
    cache: KernelCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    owner = cache.folder.stat().st_uid
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    with pytest.raises(FileError):
        list(kernel_caches())  # the temporary one seems to be another's, too


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
    with suppress(FileError):  # of the temporary one, where the tests do not run as root
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


def test_the_temporary_folder_is_gone_when_its_process_is_but_outlives_forks(
    tmp_path: Path,
) -> None:
    program = (
        "import os, sys; from baxter_kin.compilation.kernel_cache import temporary_folder\n"
        "folder = temporary_folder()\n"
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


def test_a_kept_library_is_found_and_replaces_the_one_before(cache: KernelCache) -> None:
    keep(cache, "key", b"old")
    library = keep(cache, "key", b"new")
    assert library.read_bytes() == b"new"
    assert library.stat().st_mode & 0o777 == 0o600
    assert cache.library("key") is not None
    assert cache.library("other") is None


@pytest.mark.parametrize("content", [b"", b"conten", b"other content"])
def test_a_damaged_library_is_not_taken_and_removed(cache: KernelCache, content: bytes) -> None:
    library = keep(cache, "key")
    assert cache.library("key") == library
    library.write_bytes(content)
    assert cache.library("key") is None
    assert not library.exists()


@pytest.mark.parametrize("later_s", [0.0, 1e9])
def test_the_newest_libraries_are_kept(cache: KernelCache, later_s: float) -> None:
    """A new one also where others are from the future."""
    for number in range(MAX_LIBRARIES + 3):
        os.utime(keep(cache, f"{number}"), (later_s + number,) * 2)
        assert cache.library(f"{number}") is not None
    kept = {path.stem.split("-")[0] for path in cache.folder.glob("*.so")}
    assert len(kept) == MAX_LIBRARIES
    assert later_s or kept == {f"{number}" for number in range(3, MAX_LIBRARIES + 3)}


def test_abandoned_builds_are_removed_after_a_day(cache: KernelCache) -> None:
    old, recent = cache.folder / "build-old", cache.folder / "build-recent"
    for folder, age_s in ((old, ABANDONED_AFTER_S + 60.0), (recent, ABANDONED_AFTER_S - 60.0)):
        folder.mkdir()
        (folder / "kernel.c").touch()
        os.utime(folder, (time.time() - age_s,) * 2)
    keep(cache, "key")
    assert recent.exists()
    assert not old.exists()
