"""The folder of compiled kernels: where it is, and what becomes of those of old sources."""

import multiprocessing
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from soro_core.files import kernel_folder as folders
from soro_core.files.kernel_folder import UNUSED_S, kernel_folder

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


@pytest.fixture
def temp(tmp_path, monkeypatch):
    """Folder of this user in a temp folder that others share; the home cannot be written."""
    (tmp_path / "file").write_text("")  # no folder can be made below a file
    (tmp_path / "temp").mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(folders.tempfile, "tempdir", str(tmp_path / "temp"))
    return tmp_path / "temp" / f"soro-{os.getuid()}"


def mode(path: Path) -> int:
    return path.stat().st_mode & 0o777


def is_refused(found: Path, temp: Path, caplog) -> bool:
    """Whether a folder of this process alone was taken, and one line said so."""
    lines = [record.getMessage() for record in caplog.records]
    assert len(lines) == 1
    assert f"{temp}: " in lines[0]
    assert "set XDG_CACHE_HOME" in lines[0]
    assert mode(found) == 0o700
    return temp not in found.parents and not any(found.iterdir())


def test_it_falls_back_where_it_may_not_write(temp, caplog):
    folder = kernel_folder("abc")
    assert folder == temp / "kernels-abc"
    assert mode(temp) == mode(folder) == 0o700
    assert kernel_folder("abc") == folder
    assert caplog.records == []


def test_a_link_in_the_temp_folder_is_not_followed(temp, tmp_path, caplog):
    old(tmp_path / "theirs" / "kernels-abc", 0.0)
    temp.symlink_to(tmp_path / "theirs")
    assert is_refused(kernel_folder("abc"), temp, caplog)


def test_a_folder_of_another_user_is_not_used(temp, monkeypatch, caplog):
    old(temp / "kernels-abc", 0.0)
    theirs = temp.lstat()
    lstat = Path.lstat
    other = os.stat_result((*theirs[:4], theirs.st_uid + 1, *theirs[5:10]))
    monkeypatch.setattr(Path, "lstat", lambda path: other if path == temp else lstat(path))
    assert is_refused(kernel_folder("abc"), temp, caplog)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder to another user")
def test_a_folder_that_another_user_has_made_is_not_used(temp, caplog):
    os.chown(old(temp / "kernels-abc", 0.0).parent, 65534, 65534)
    assert is_refused(kernel_folder("abc"), temp, caplog)


@pytest.mark.parametrize("bits", [0o777, 0o775, 0o1777])
def test_kernels_that_others_could_write_are_not_used(temp, bits, caplog):
    old(temp / "kernels-abc", 0.0).chmod(bits)
    assert is_refused(kernel_folder("abc"), temp, caplog)


def test_a_folder_that_others_could_replace_is_not_used(temp, caplog):
    temp.parent.chmod(0o777)
    assert is_refused(kernel_folder("abc"), temp, caplog)
    temp.parent.chmod(0o1777)
    assert kernel_folder("abc") == temp / "kernels-abc"


def test_a_root_that_others_could_write_is_closed_to_them(root):
    root.mkdir()
    root.chmod(0o777)
    kernel_folder("abc")
    assert mode(root) == 0o755
    assert mode(root / "kernels-abc") == 0o700


def test_a_lock_that_is_a_link_empties_nothing(temp, tmp_path, caplog):
    (tmp_path / "precious").write_text("kept")
    temp.mkdir(mode=0o700)
    (temp / "kernels.lock").symlink_to(tmp_path / "precious")
    assert is_refused(kernel_folder("abc"), temp, caplog)
    assert (tmp_path / "precious").read_text() == "kept"


@pytest.mark.process
def test_a_folder_of_one_process_goes_with_it(temp, tmp_path):
    temp.write_text("in the way")
    code = "import soro_core.files.kernel_folder as f; print(f.kernel_folder('abc'))"
    environment = {**os.environ, "TMPDIR": str(temp.parent), "PYTHONPATH": str(Path.cwd())}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0
    assert not Path(done.stdout.strip()).exists()
    assert done.stderr.startswith("soro: compiled kernels are not kept, each start compiles them again (")
    assert done.stderr.count("\n") == 1


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


@pytest.mark.process
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
