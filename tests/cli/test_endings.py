"""Commands that are ended from outside: by signals, by a disk without room, by a folder that takes no files."""

import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxrmp import ConfigurationError, learning
from jaxrmp._files import atomic_write
from jaxrmp.cli import main
from jaxrmp.cli._ending import Ended, ended_by_signals
from jaxrmp.evaluation import _finished, evaluate, limit_leaf, sample_starts, skill_problem
from jaxrmp.kinematics import panda
from jaxrmp.simulation import KinematicEngine, StopCriteria
from jaxrmp.xla._c_compiler import library_of

from ..evaluation.reaching import reaching_skill

CONFIG = str(Path(__file__).parents[2] / "configs" / "drawer_closing.toml")
LONG = ["--starts", "100000", "--batch", "16", "--dt", "0.001"]


@pytest.fixture(scope="module")
def skill_file(tmp_path_factory):
    return str(learning.save_skill(reaching_skill(), tmp_path_factory.mktemp("skill") / "reach.skill.npz"))


def started(*arguments: str, until: str, cache: str = "", **variables: str) -> subprocess.Popen:
    """The command in a process of its own, once it has printed `until`; its compiled programs are in `cache`."""
    cache = cache or str(jax.config.jax_compilation_cache_dir or "")
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "JAX_COMPILATION_CACHE_DIR": cache, **variables}
    command = [sys.executable, "-m", "jaxrmp", *arguments]
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # that it be heard, whatever these tests were started by
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
    signal.signal(signal.SIGHUP, before)
    assert process.stderr is not None
    said = []
    for line in process.stderr:
        said.append(line)
        if until in line:
            return process
    pytest.fail(f"{arguments} never said {until!r}: {''.join(said)}")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGHUP, 129)])
def test_a_signal_ends_rollouts_and_what_has_ended_is_kept(skill_file, tmp_path, number, code):
    report = tmp_path / "report.json"
    process = started("evaluate", skill_file, *LONG, "--json", str(report), until=" ended, ")
    process.send_signal(number)
    _, rest = process.communicate(timeout=60)
    assert process.returncode == code and "interrupted" in rest and "Traceback" not in rest
    assert f"--resume goes on from {tmp_path / 'report.finished.npz'}" in rest
    assert [file.name for file in tmp_path.iterdir()] == ["report.finished.npz"]
    with np.load(tmp_path / "report.finished.npz") as kept:
        assert 0 < kept["done"].sum() < 100000


def test_a_terminal_that_closes_ends_nothing_that_was_told_not_to_mind():
    """As `nohup` tells."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_by_signals():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
            with pytest.raises(Ended):
                signal.raise_signal(signal.SIGTERM)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_signal_ends_a_step_that_does_not_hear_it(tmp_path):
    program = (
        "import signal, sys, time\n"
        "from jaxrmp._files import atomic_write\n"
        "from jaxrmp.cli._ending import ended_by_signals\n"
        "with ended_by_signals(), atomic_write(sys.argv[1] + '/half'):\n"
        "    signal.signal(signal.SIGTERM, lambda *_: None)\n"  # as in a compilation, where no handler of Python runs
        "    print('deaf', flush=True)\n"
        "    time.sleep(60)\n"
    )
    command = [sys.executable, "-c", program, str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "deaf\n"
    assert len(os.listdir(tmp_path)) == 1  # half written
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 143 and "interrupted" in said
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(("command", "number"), [("view", signal.SIGTERM), ("teach", signal.SIGINT)])
def test_a_page_ends_well_while_its_threads_compile(tmp_path, command, number):
    pytest.importorskip("viser", reason="needs viser: pip install 'jaxrmp[viewer]'")
    out, cache = tmp_path / "out", str(tmp_path / "cache")
    words = [command, "--port", "0", *(["--out", str(out)] if command == "teach" else [])]
    process = started(*words, until="compiling", cache=cache, XLA_FLAGS="")  # with all that XLA does
    time.sleep(3.0)  # by then its programs are being compiled, which takes longer
    process.send_signal(number)
    printed, said = process.communicate(timeout=30)  # it takes one or two
    assert process.returncode == 0, said
    assert "The page is at" not in printed and "Traceback" not in said
    assert not out.exists()


def test_a_c_compiler_and_its_folder_go_with_the_process(tmp_path):
    """A compiler that takes long, and whose work is done by a process that it starts, as those of GCC are."""
    compiler, cache, pids = tmp_path / "cc", tmp_path / "cache", tmp_path / "pids"
    compiler.write_text(
        f'#!/bin/sh\n[ "$1" = --version ] && exit\nsleep 600 &\nmktemp -p "$TMPDIR"\necho $$ $! > {pids}.new\n'
        f"mv {pids}.new {pids}\nwait\n"
    )
    compiler.chmod(0o700)
    program = (
        "import signal, threading, time\n"
        "from jaxrmp.cli._ending import ended_by_signals\n"
        "from jaxrmp.xla._c_compiler import library_of\n"
        "with ended_by_signals():\n"
        "    signal.signal(signal.SIGTERM, lambda *_: None)\n"
        "    threading.Thread(target=library_of, args=('', '', []), daemon=True).start()\n"
        "    time.sleep(60)\n"
    )
    environment = {**os.environ, "CC": str(compiler), "JAXRMP_CACHE": str(cache), "TMPDIR": str(tmp_path)}
    process = subprocess.Popen([sys.executable, "-c", program], env=environment)
    deadline = time.monotonic() + 60
    while not pids.exists():
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.1)
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=30) == 143
    assert list(cache.iterdir()) == []
    assert not any(_alive(int(pid)) for pid in pids.read_text().split())


def test_folders_that_killed_compilers_left_go_after_an_hour(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXRMP_CACHE", str(tmp_path))
    for name in ("tmp_old", "tmp_new", "spheres"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text("")
    for name in ("tmp_old", "spheres"):
        os.utime(tmp_path / name, (0, time.time() - 4000))
    library = library_of("int one(void) { return 1; }", "-shared -fPIC", [])
    assert {file.name for file in tmp_path.iterdir()} == {"tmp_new", "spheres", library.name}


def test_no_process_outlives_the_one_that_started_it(skill_file, tmp_path):
    command = ["evaluate", skill_file, *LONG, "--processes", "2", "--json", str(tmp_path / "report.json")]
    for number in (signal.SIGTERM, signal.SIGKILL):
        process = started(*command, until=" rollouts (kinematic)")
        children = _children(process.pid)
        assert len(children) >= 2
        process.send_signal(number)
        process.wait(timeout=60)
        deadline = time.monotonic() + 60
        while any(map(_alive, children)):
            assert time.monotonic() < deadline, "a process of several lives on"
            time.sleep(0.1)


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _alive(pid: int) -> bool:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def test_what_processes_say_is_labelled(skill_file, tmp_path):
    report = tmp_path / "report.json"
    quick = ["--starts", "16", "--batch", "16", "--duration", "2", "--dt", "0.01"]  # in the batches of LONG
    command = ["evaluate", skill_file, *quick, "--processes", "2"]
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(jax.config.jax_compilation_cache_dir or tmp_path)}
    done = subprocess.run(
        [sys.executable, "-m", "jaxrmp", *command, "--json", str(report)],
        capture_output=True,
        check=False,
        text=True,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    assert "process 0: " in done.stderr and "process 1: " in done.stderr
    assert json.loads(report.read_text())["starts"] == 16
    assert list(tmp_path.glob("*.finished*")) == []


def test_an_evaluation_goes_on_from_what_was_kept(skill_file, tmp_path, monkeypatch):
    skill, robot = learning.load_skill(skill_file), panda()
    problem = skill_problem(skill, robot)
    engine = KinematicEngine(problem, StopCriteria(duration=4.0), dt=0.005)
    starts = sample_starts(problem, 24)
    keep = tmp_path / "kept.npz"

    class Stopped(Exception):
        pass

    def stop(ended: int, own: int) -> None:
        if ended >= 8:
            raise Stopped

    def evaluated(**options):
        return evaluate(engine, problem, limit_leaf(skill, robot), starts, batch=8, **options)

    with pytest.raises(Stopped):
        evaluated(progress=stop, keep=keep)
    with np.load(keep) as kept:
        done = int(kept["done"].sum())
    assert 8 <= done < 24
    counts = []
    again = evaluated(progress=lambda ended, own: counts.append(ended), keep=keep)
    assert counts[0] == done and counts[-1] == 24
    whole = evaluated()
    np.testing.assert_array_equal(again.ends.kind, whole.ends.kind)
    np.testing.assert_allclose(again.outcomes.q, whole.outcomes.q, atol=1e-4)
    np.testing.assert_allclose(again.outcomes.track.margin, whole.outcomes.track.margin, atol=1e-4)
    with pytest.raises(ConfigurationError, match="another evaluation"):
        evaluate(engine, problem, None, starts[:8] + 0.01, keep=keep)
    monkeypatch.setattr(_finished, "__version__", "0.0.0")
    with pytest.raises(ConfigurationError, match="another evaluation: of another skill, version"):
        evaluated(keep=keep)
    keep.write_bytes(b"damaged")
    with pytest.raises(ConfigurationError, match="remove it"):
        evaluated(keep=keep)


def test_resume_asks_for_what_it_needs(skill_file, tmp_path, capsys):
    assert main(["evaluate", skill_file, "--resume"]) == 1
    assert "--json" in capsys.readouterr().err
    report, quick = tmp_path / "r.json", ["--starts", "16", "--batch", "16", "--duration", "0.1", "--dt", "0.01"]
    assert main(["evaluate", skill_file, *quick, "--resume", "--json", str(report)]) == 0
    assert "nothing is kept yet in" in capsys.readouterr().err and report.exists()


def test_a_process_started_by_hand_goes_on_only_when_asked(skill_file, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("jaxrmp.evaluation.join_processes", lambda *_: None)  # this process is one already
    report, kept = tmp_path / "r.json", tmp_path / "r.finished.npz"
    kept.write_bytes(b"of another evaluation")
    quick = ["--starts", "16", "--batch", "16", "--duration", "0.1", "--dt", "0.01", "--json", str(report)]
    command = ["evaluate", skill_file, *quick, "--process", "0"]
    assert main(command) == 1 and kept.exists()  # it lacks a coordinator
    command += ["--coordinator", "127.0.0.1:1"]
    assert main([*command, "--resume"]) == 1 and kept.exists()
    assert "remove it" in capsys.readouterr().err
    assert main(command) == 0
    assert "removed, as without --resume" in capsys.readouterr().err and not kept.exists()


WRITES = [
    ["demonstrate", "drawer_closing", "OUT", "--count", "2"],
    ["export", "SKILL", "--c", "OUT"],
    ["reproduce", "SKILL", "--json", "OUT/r.json", "--demos", "synthetic:drawer_closing"],
    ["evaluate", "SKILL", "--json", "OUT/r.json", "--starts", "8", "--duration", "0.1"],
]


@pytest.mark.parametrize("command", WRITES, ids=lambda command: command[0])
def test_a_disk_without_room_leaves_nothing_half_written(learned_drawer, tmp_path, capsys, command):
    skill_file, out = str(learned_drawer / "drawer_closing.skill.npz"), tmp_path / "out"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))  # files may have 100 bytes: what is longer fails
    try:
        code = main([word.replace("OUT", str(out)).replace("SKILL", skill_file) for word in command])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    said = capsys.readouterr().err
    assert code == 1 and "cannot write" in said and "Traceback" not in said
    assert [file for file in out.rglob("*") if file.is_file() and file.stat().st_size >= 100] == []
    assert list(out.rglob(".*")) == []


@pytest.mark.parametrize("command", WRITES, ids=lambda command: command[0])
def test_a_place_that_takes_no_files_is_told(learned_drawer, tmp_path, capsys, command):
    skill_file = str(learned_drawer / "drawer_closing.skill.npz")
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "out"
    assert main([word.replace("OUT", str(out)).replace("SKILL", skill_file) for word in command]) == 1
    said = capsys.readouterr().err
    assert "cannot write" in said and str(tmp_path) in said


def test_signals_are_as_before_once_a_command_is_over(tmp_path):
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    assert main(["check", CONFIG, "--quiet"]) in (0, 1)
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before
    assert signal.set_wakeup_fd(-1) == -1
    assert not [thread for thread in threading.enumerate() if "listen" in thread.name]


@pytest.mark.parametrize("option", ["--json", "--html", "--save"])
def test_what_cannot_be_written_is_told_before_the_work(tmp_path, capsys, option):
    (tmp_path / "file").write_text("")
    for place in ("file/r", ".", "/proc/r"):
        path = tmp_path / place
        assert main(["evaluate", "no.skill.npz", option, str(path)]) == 1  # of which nothing is read
        assert f"cannot write {option} {path}: " in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["file"]
    with pytest.raises(OSError) as told, atomic_write("/proc/r"):
        pass
    assert told.value.filename == "/proc/r"
