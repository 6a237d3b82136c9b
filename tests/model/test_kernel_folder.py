"""The folder of compiled kernels: where it is, and what becomes of those of old sources."""

import multiprocessing
import os
import time
from pathlib import Path

import pytest

from soro_core import kernel_folder as folders
from soro_core.kernel_folder import UNUSED_S, kernel_folder

AT_ONCE = 4


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "soro"


def old(folder: Path, age_s: float) -> Path:
    """Make a folder with a kernel in it, last asked for so long ago."""
    (folder / "model_1").mkdir(parents=True)
    (folder / "model_1" / "kernel.nbc").write_text("code")
    then = time.time() - age_s
    os.utime(folder, (then, then))
    return folder


def names(root: Path) -> set[str]:
    return {path.name for path in root.iterdir() if path.is_dir()}


def test_it_is_in_the_cache_of_the_user_and_named_by_the_version(root):
    assert kernel_folder("abc") == root / "kernels-abc"
    assert (root / "kernels-abc").is_dir()


def test_it_falls_back_where_it_may_not_write(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("")  # no folder can be made below a file
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    monkeypatch.setattr(folders.tempfile, "gettempdir", lambda: str(tmp_path / "temp"))
    folder = kernel_folder("abc")
    assert folder.is_dir()
    assert (tmp_path / "temp") in folder.parents


def test_what_was_long_unused_goes_and_nothing_else(root):
    old(root / "kernels-gone", UNUSED_S + 60.0)
    old(root / "kernels-recent", UNUSED_S - 60.0)
    old(root / "kernels-mine", UNUSED_S + 60.0)
    old(root / "trade", UNUSED_S + 60.0)
    old(root / "unused-kernels-left-7", 0.0)  # by a process that ended meanwhile
    (root / "kernels-file").write_text("")
    os.utime(root / "kernels-file", (0.0, 0.0))
    kernel_folder("mine")
    assert names(root) == {"kernels-recent", "kernels-mine", "trade"}
    assert (root / "kernels-mine" / "model_1" / "kernel.nbc").is_file()
    assert (root / "kernels-file").is_file()


def test_asking_for_it_keeps_it(root):
    old(root / "kernels-mine", UNUSED_S - 60.0)
    kernel_folder("mine")
    assert time.time() - (root / "kernels-mine").stat().st_mtime < 60.0
    kernel_folder("other")
    assert "kernels-mine" in names(root)


def test_without_locks_nothing_is_removed(root, monkeypatch):
    monkeypatch.setattr(folders, "locked", lambda path: folders.contextlib.nullcontext(False))
    old(root / "kernels-gone", UNUSED_S + 60.0)
    assert kernel_folder("mine").is_dir()
    assert "kernels-gone" in names(root)


def ask(start, cache: str, answers) -> None:
    os.environ["XDG_CACHE_HOME"] = cache
    start.wait()
    for turn in range(20):
        folder = kernel_folder(f"mine{turn % 3}")
        kernel = folder / f"{os.getpid()}-{turn}"
        kernel.write_text("code")
        answers.put(kernel.read_text() == "code" and folder.parent.name == "soro")


def test_several_at_once(root):
    """Each finds its folder and can write there, while all of them remove the same old ones."""
    for k in range(20):
        old(root / f"kernels-gone{k}", UNUSED_S + 60.0)
    for k in range(3):
        old(root / f"kernels-mine{k}", UNUSED_S + 60.0)
    context = multiprocessing.get_context("fork")
    start, answers = context.Barrier(AT_ONCE), context.Queue()
    processes = [context.Process(target=ask, args=(start, str(root.parent), answers)) for _ in range(AT_ONCE)]
    for process in processes:
        process.start()
    good = [answers.get(timeout=30.0) for _ in range(20 * AT_ONCE)]
    for process in processes:
        process.join(30.0)
        assert process.exitcode == 0
    assert all(good)
    assert names(root) == {"kernels-mine0", "kernels-mine1", "kernels-mine2"}
