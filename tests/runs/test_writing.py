"""Files appear whole or not at all, on file systems of any kind."""

import errno
import os
import stat
from concurrent.futures import ThreadPoolExecutor

import pytest

from locomotion.writing import atomic_write, remove_partial, sync


@pytest.mark.parametrize("number", [errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EBADF])
def test_a_file_system_that_cannot_sync_is_written_to(number, monkeypatch, tmp_path):
    def refuse(descriptor):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", refuse)
    with atomic_write(tmp_path / "a.txt") as partial:
        partial.write_text("whole", encoding="utf-8")
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "whole"


def test_windows_syncs_files_that_are_open_for_writing_alone(monkeypatch, tmp_path):
    opened, synced = os.open, []

    def open_no_folder(path, flags, *args, **keywords):
        if os.path.isdir(path):
            raise PermissionError(errno.EACCES, "a folder", path)
        return opened(path, flags, *args, **keywords)

    def fsync(descriptor):
        os.pwrite(descriptor, b"w", 0)  # fails unless it is open for writing
        synced.append(descriptor)

    monkeypatch.setattr(os, "open", open_no_folder)
    monkeypatch.setattr(os, "fsync", fsync)
    with atomic_write(tmp_path / "a.txt") as partial:
        partial.write_text("whole", encoding="utf-8")
    assert len(synced) == 1
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "whole"


def test_a_disk_that_fails_is_not_passed_over(monkeypatch, tmp_path):
    def fail(descriptor):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", fail)
    target = tmp_path / "a.txt"
    target.write_text("before", encoding="utf-8")
    with pytest.raises(OSError, match="error") as caught, atomic_write(target) as partial:
        partial.write_text("after", encoding="utf-8")
    assert (caught.value.errno, caught.value.filename) == (errno.EIO, str(target))
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert target.read_text(encoding="utf-8") == "before"
    with pytest.raises(OSError, match="error"):
        sync(0)


@pytest.mark.parametrize("ending", ["", ".txt", ".tar.gz"])
def test_a_name_may_be_as_long_as_the_file_system_takes(ending, tmp_path):
    target = tmp_path / f"{'é' * ((255 - len(ending)) // 2)}{ending}"
    with atomic_write(target) as partial:
        assert partial.suffix == target.suffix
        partial.write_text("whole", encoding="utf-8")
    assert list(tmp_path.iterdir()) == [target]


def test_a_link_stays_one_and_a_file_has_the_rights_of_any_other(tmp_path):
    (tmp_path / "folder").mkdir()
    link, plain = tmp_path / "link.txt", tmp_path / "plain.txt"
    link.symlink_to(tmp_path / "folder" / "there.txt")
    plain.write_text("x", encoding="utf-8")
    with atomic_write(link) as partial:
        partial.write_text("whole", encoding="utf-8")
    assert link.is_symlink()
    there = tmp_path / "folder" / "there.txt"
    assert there.read_text(encoding="utf-8") == "whole"
    assert stat.S_IMODE(there.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)


def test_two_who_write_one_file_at_once_do_not_mix(tmp_path):
    target = tmp_path / "a.txt"

    def write(letter):
        with atomic_write(target) as partial, partial.open("w", encoding="utf-8") as file:
            for _ in range(200):
                file.write(letter * 100)
                file.flush()

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(write, "abcd"))
    text = target.read_text(encoding="utf-8")
    assert len(text) == 20_000 and len(set(text)) == 1
    assert list(tmp_path.iterdir()) == [target]


def test_a_file_that_cannot_be_written_is_named_by_its_own_name(tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    for target in (tmp_path / "no" / "a.txt", tmp_path / "file" / "a.txt"):
        with pytest.raises(OSError, match="director") as caught, atomic_write(target) as partial:
            partial.write_text("", encoding="utf-8")
        assert caught.value.filename == str(target)


def test_what_a_killed_process_left_is_removed(tmp_path):
    (tmp_path / "a.txt").write_text("", encoding="utf-8")
    with atomic_write(tmp_path / "b.txt") as partial:
        partial.write_text("half", encoding="utf-8")
        remove_partial(tmp_path)
        assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
        partial.write_text("whole", encoding="utf-8")
