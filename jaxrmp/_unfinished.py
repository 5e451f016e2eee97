"""What is under way, and must go with a process that ends without another word: files half written, programs called."""

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

_OLD = 3600.0  # s, after which nobody works in a folder any more
_PATIENCE = 0.2  # s, for what is begun at this moment, and for a program that was killed
_beginning = threading.Lock()
_paths = set[str]()  # files and folders, under the names that they have until they are whole
_programs = set[subprocess.Popen[str]]()


@contextlib.contextmanager
def temporary_file(beside: Path) -> Iterator[tuple[int, str]]:
    """A new file next to `beside`, of a name that nobody has, as descriptor and path. It is removed if the block fails,
    else left. **Raises** `OSError`, which names `beside`, where no file can be made."""
    with _beginning:
        try:
            handle, path = tempfile.mkstemp(dir=beside.parent, prefix=f".{beside.name}.")
        except OSError as error:
            error.filename = str(beside)  # not one that nobody has asked for
            raise
        _paths.add(path)
    try:
        yield handle, path
    except BaseException:
        _remove(path)
        raise
    finally:
        _paths.discard(path)


@contextlib.contextmanager
def working_folder(folder: Path) -> Iterator[Path]:
    """A new folder in `folder`, for the time of the block. Those that killed processes left there an hour ago go."""
    for left in folder.glob("tmp*"):
        with contextlib.suppress(OSError):  # somebody else removes it, too
            if left.is_dir() and time.time() - left.stat().st_mtime > _OLD:
                _remove(str(left))
    with _beginning:
        made = tempfile.mkdtemp(dir=folder)
        _paths.add(made)
    try:
        yield Path(made)
    finally:
        _remove(made)
        _paths.discard(made)


def call(command: Sequence[str], folder: Path, timeout: float) -> subprocess.CompletedProcess[str]:
    """Run a program, whose own temporary files are in `folder`, to its end, and return what it said.

    It is in a group of processes of its own, so that what it starts is ended with it.
    **Raises** `OSError` where it cannot be started, `subprocess.TimeoutExpired` after `timeout`, s.
    """
    own = {"env": {**os.environ, "TMPDIR": str(folder)}, "process_group": 0}
    with _beginning:
        program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **own)
        _programs.add(program)
    with program:
        try:
            said, wrong = program.communicate(timeout=timeout)
        except BaseException:
            _kill(program)
            raise
        finally:
            _programs.discard(program)
    return subprocess.CompletedProcess(command, program.returncode, said, wrong)


def forget_unfinished() -> None:
    """End the programs and remove the files that are under way: for a process that ends without another word, in which
    nothing can be begun any more."""
    _beginning.acquire(timeout=_PATIENCE)
    programs = list(_programs)
    for program in programs:
        _kill(program)
    for program in programs:
        with contextlib.suppress(subprocess.TimeoutExpired):
            program.wait(_PATIENCE)  # before its folder goes, in which it may write
    for path in list(_paths):
        _remove(path)


def _kill(program: subprocess.Popen[str]) -> None:
    if program.returncode is None:
        with contextlib.suppress(OSError):
            os.killpg(program.pid, signal.SIGKILL)


def _remove(path: str) -> None:
    if os.path.isdir(path):
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            os.unlink(path)
