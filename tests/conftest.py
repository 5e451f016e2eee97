"""What all tests share: compiled programs kept between runs, skills learned once, and what a worker may hold."""

import ctypes.util
import gc
import json
import os
import resource
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable
from functools import partial
from importlib import metadata
from pathlib import Path

from packaging.version import Version

# Tests compile much and run little of it. XLA takes a quarter of the time without these two, and runs nearly as fast.
_FLAGS = "--xla_backend_optimization_level=0"
if Version(metadata.version("jaxlib")) < Version("0.11"):  # a flag that is not known ends the process
    _FLAGS += " --xla_cpu_use_fusion_emitters=false"
os.environ["XLA_FLAGS"] = f"{_FLAGS} {os.environ.get('XLA_FLAGS', '')}"  # read by the first program that is compiled

import jax  # noqa: E402
import pytest  # noqa: E402
from packaging.requirements import Requirement  # noqa: E402

if not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
    jax.config.update("jax_compilation_cache_dir", str(Path(__file__).parent.parent / ".jax_cache"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)

os.environ.setdefault("JAXRMP_CACHE", str(Path(__file__).parent.parent / ".jax_cache" / "c"))

DISPLAY = bool(os.environ.get("MUJOCO_GL") or os.environ.get("DISPLAY")) or sys.platform != "linux"
if not DISPLAY and ctypes.util.find_library("OSMesa"):
    os.environ["MUJOCO_GL"] = "osmesa"  # read when mujoco is imported, whichever test does so first
    DISPLAY = True

CONFIGS = Path(__file__).parents[1] / "configs"
MOST_MB = 2500  # that a worker may ever hold
FULL_MB, MORE_MB = 900, 500  # above this, and that over what could not be let go, what can is let go before a file ends
LESS = {"method": "paper", "metric.updates": 100, "potential.widths": [0.05], "potential.basin_starts": 100}
FEW = [word for name, value in LESS.items() for word in (f"--{name}", str(value))]


@pytest.fixture(scope="session")
def can_draw() -> bool:
    """Whether MuJoCo can draw here: with a display or with OSMesa, which `make test` installs as root."""
    return DISPLAY


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of the real recordings, or a skipped test that says why."""
    folder = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "franka"
    if not folder.is_dir():
        pytest.skip("needs the real recordings: set JAXRMP_DATA to the folder that holds franka/")
    return folder


@pytest.fixture(scope="session")
def once(tmp_path_factory) -> Callable[[str, Callable[[Path], object]], Path]:
    """`once(name, make)`: a folder that `make(folder)` fills for all workers together, the first that asks."""
    from filelock import FileLock

    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def once(name: str, make: Callable[[Path], object]) -> Path:
        folder, done = base / f"once-{name}", base / f"once-{name}.done"
        with FileLock(f"{done}.lock"):
            if not done.exists():
                folder.mkdir(exist_ok=True)
                make(folder)
                done.touch()
        return folder

    return once


@pytest.fixture(scope="session")
def bare_python(once) -> Path:
    """The interpreter of a fresh virtual environment that holds what `pip install jaxrmp` brings and nothing else."""

    def make(folder: Path) -> None:
        site = environment(folder / "bare", base_of("jaxrmp"))
        (site / "jaxrmp").symlink_to(Path(__file__).parents[1] / "jaxrmp")

    return once("bare-python", make) / "bare" / "bin" / "python"


@pytest.fixture(scope="session")
def jax_python(once) -> Path:
    """The interpreter of a fresh virtual environment with jax and flatbuffers, and no jaxrmp."""
    pytest.importorskip("flatbuffers", reason="needs flatbuffers: pip install 'jaxrmp[export]'")
    make = partial(environment, wanted={"jax", "flatbuffers"} | base_of("jax"))
    return once("jax-python", lambda folder: make(folder / "jax")) / "jax" / "bin" / "python"


def environment(folder: Path, wanted: set[str]) -> Path:
    """A virtual environment in `folder` of this one's files of the `wanted` distributions; its folder of packages."""
    venv.create(folder, with_pip=False, symlinks=True)
    site = Path(sysconfig.get_path("purelib", "venv", vars={"base": str(folder)}))
    for name in wanted:
        for top in {file.parts[0] for file in metadata.files(name) or ()} - {"..", "__pycache__"}:
            if not (site / top).exists():  # a folder that several have in common
                (site / top).symlink_to(metadata.distribution(name).locate_file(top))
    return site


def base_of(name: str, *extras: str) -> set[str]:
    """The distributions that one asks for with these extras, by default with none, directly or not."""
    seen: set[tuple[str, str]] = set()
    left = [(name, extra) for extra in ("", *extras)]
    while left:
        name, extra = left.pop()
        for line in metadata.requires(name) or ():
            requirement = Requirement(line)
            if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
                new = {(requirement.name, asked) for asked in ("", *requirement.extras)} - seen
                seen |= new
                left += new
    return {name for name, _ in seen}


def run_in(python: Path, program: str, *arguments) -> dict:
    """What a program prints last, as JSON, run by an interpreter that sees nothing of this environment."""
    hidden = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    done = subprocess.run(
        [str(python), "-c", program, *map(str, arguments)],
        check=False,
        capture_output=True,
        text=True,
        env={key: value for key, value in os.environ.items() if key not in hidden},
        cwd=python.parent,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="session")
def run_bare(bare_python) -> Callable[..., dict]:
    """`run_in` with `bare_python`."""
    return partial(run_in, bare_python)


@pytest.fixture(scope="session")
def run_jax(jax_python) -> Callable[..., dict]:
    """`run_in` with `jax_python`."""
    return partial(run_in, jax_python)


@pytest.fixture(scope="session")
def drawer_demonstrations(once) -> Path:
    """The folder that `jaxrmp demonstrate drawer_closing` writes: six synthetic demonstrations. Only to be read."""
    from jaxrmp.cli import main

    def make(folder: Path) -> None:
        assert main(["demonstrate", "drawer_closing", str(folder / "drawer")]) == 0

    return once("drawer-demonstrations", make) / "drawer"


@pytest.fixture(scope="session")
def learned_drawer(once, drawer_demonstrations) -> Path:
    """The folder that `jaxrmp learn` writes for the drawer: a skill file and its reports. Only to be read.

    Learned from `drawer_demonstrations` with little work (`LESS`); `learned.json` holds what `--json` says.
    """
    from jaxrmp.cli import main

    def make(folder: Path) -> None:
        command = ["learn", str(CONFIGS / "drawer_closing.toml"), "--demos", str(drawer_demonstrations), *FEW]
        assert main([*command, "--out", str(folder), "--json", str(folder / "learned.json")]) == 0

    return once("learned-drawer", make)


@pytest.fixture(scope="session")
def drawer_skill(learned_drawer):
    """The skill of `learned_drawer`: three control points of the Panda's hand, in the drawer's frame."""
    from jaxrmp.learning import load_skill

    return load_skill(learned_drawer / "drawer_closing.skill.npz")


@pytest.fixture(scope="session")
def door_learning(once):
    """A `Learning` of the door, from six synthetic demonstrations with little work (`LESS`)."""
    import pickle

    from jaxrmp.kinematics import panda
    from jaxrmp.learning import learn, load_configuration
    from jaxrmp.synthetic import synthetic_demonstrations

    def make(folder: Path) -> None:
        configuration = load_configuration(CONFIGS / "door_reaching.toml", LESS)
        learning = learn(configuration, panda(), synthetic_demonstrations("door_reaching"))
        (folder / "learning.pickle").write_bytes(pickle.dumps(learning))

    return pickle.loads((once("door-learning", make) / "learning.pickle").read_bytes())


def pytest_collection_finish():
    """Tracing makes many objects that live: looking for dead ones as often as Python does takes a fifth of its time."""
    gc.freeze()
    gc.set_threshold(100_000, 20, 50)


def held_mb() -> int:
    """What this process holds in memory, MB; on systems without /proc, the most that it ever held."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") >> 20
    except OSError:
        return peak_mb()


def peak_mb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> (20 if sys.platform == "darwin" else 10)


def cpu_seconds() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def trim() -> None:
    """Give back to the system what is free: compiling frees much that the allocator keeps."""
    gc.collect()
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)


_held_on_to = [0]  # MB, after what could go was let go for the last time


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item, nextitem):
    """JAX never lets a compiled program go by itself: what a file compiled goes with it, or earlier if it is much.

    To look for what is dead takes a second or two where much is alive, so that is done when it may be worth it.
    """
    full = held_mb() > max(FULL_MB, _held_on_to[0] + MORE_MB)
    if full or nextitem is None or nextitem.path != item.path:
        jax.clear_caches()
    if full:
        trim()
        _held_on_to[0] = held_mb()


def pytest_sessionfinish(session):
    found = {"mb": peak_mb(), "seconds": cpu_seconds()}
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output.update(found)
    elif not getattr(session.config.option, "numprocesses", None):
        session.config.stash.setdefault(USED, {})["the process"] = found


USED = pytest.StashKey[dict]()


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node, error):
    if hasattr(node, "workeroutput"):
        node.config.stash.setdefault(USED, {})[node.gateway.id] = dict(node.workeroutput)


def pytest_terminal_summary(terminalreporter, config):
    used = config.stash.get(USED, {})
    for name, found in sorted(used.items()):
        told = f"{name}: {found['seconds'] / 60:.1f} min of CPU time, at most {found['mb']} MB"
        terminalreporter.write_line(told + (f", more than {MOST_MB}" if found["mb"] > MOST_MB else ""))
    if len(used) > 1:
        together = sum(found["seconds"] for found in used.values()) / 60
        terminalreporter.write_line(f"all workers: {together:.1f} min of CPU time")
