"""Commands where packages are not installed: pictures are left out with a line, what is needed is asked for at once."""

import os
import subprocess
from pathlib import Path

import pytest

from jaxrmp.learning import save_skill

from ..conftest import CONFIGS, base_of, environment
from ..evaluation.reaching import reaching_skill

HIDDEN = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
LEAST = ["--method", "paper", "--metric.updates=10", "--potential.widths=[0.05]", "--potential.basin_starts=10"]
REMEDY = "pip install 'jaxrmp[{0}]', or, in a clone of jaxrmp, pip install -e '.[{0}]'."
LEFT_OUT = f"jaxrmp: without pictures, for matplotlib is not installed: {REMEDY.format('plots')}"


def said(python: Path, *words) -> tuple[int, str, str]:
    """The exit code of a command, its results and what it says beside them."""
    kept = {key: value for key, value in os.environ.items() if key not in HIDDEN}
    command = [str(python), "-m", "jaxrmp", *map(str, words)]
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, cwd=python.parent, timeout=500, env=kept
    )
    return done.returncode, done.stdout, done.stderr


@pytest.fixture(scope="session")
def python(once) -> Path:
    """The interpreter of an environment of `pip install 'jaxrmp[learning,simulation]'`, and nothing else."""

    def make(folder: Path) -> None:
        site = environment(folder / "own", base_of("jaxrmp", "learning", "simulation") - {"jaxrmp"})
        (site / "jaxrmp").symlink_to(Path(__file__).parents[2] / "jaxrmp")

    return once("learning-and-simulation", make) / "own" / "bin" / "python"


def test_a_skill_is_learned_and_run_without_matplotlib(python, drawer_demonstrations, tmp_path):
    learn = ["learn", CONFIGS / "drawer_closing.toml", "--demos", drawer_demonstrations, *LEAST, "--out", tmp_path]
    code, results, told = said(python, *learn)
    assert code == 0, told
    assert LEFT_OUT in told.splitlines() and "skill written to" in results
    assert "How well it reproduces" in (tmp_path / "report.html").read_text() and not (tmp_path / "figures").exists()

    skill = tmp_path / "drawer_closing.skill.npz"
    run = ["run", skill, "--scene", "drawer", "--trials", "1", "--limit", "0.2", "--demos", drawer_demonstrations]
    code, results, told = said(python, *run, "--json", tmp_path / "run.json")
    assert code == 0, told
    assert LEFT_OUT in told.splitlines() and (tmp_path / "run.html").exists()


@pytest.mark.parametrize(
    ("words", "package", "extra"),
    [
        (["run", "SKILL", "--scene", "drawer", "--figures", "figures"], "matplotlib", "plots"),
        (["reproduce", "SKILL", "--figures", "figures"], "matplotlib", "plots"),
        (["export", "SKILL", "--stablehlo", "skill.bin"], "flatbuffers", "export"),
        (["view", "SKILL"], "viser", "viewer"),
        (["teach", "--out", "demos"], "viser", "viewer"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_what_is_asked_for_is_needed_before_the_skill_is_read(python, words, package, extra):
    code, results, told = said(python, *words)
    lines = [line for line in told.splitlines() if line.startswith("jaxrmp: ")]
    assert code == 1 and results == ""
    assert lines == [f"jaxrmp: {package} is needed for this and is not installed: {REMEDY.format(extra)}"]


def test_learning_asks_for_its_packages_before_it_reads_anything(bare_python):
    code, _, told = said(bare_python, "learn", "no such file.toml")
    assert code == 1 and "flax is needed for this" in told and "jaxrmp[learning]" in told


def test_an_evaluation_without_matplotlib(bare_python, tmp_path):
    skill = save_skill(reaching_skill(), tmp_path / "reach.skill.npz")
    quick = ["--starts", "4", "--duration", "0.1", "--dt", "0.05", "--html", tmp_path / "page.html"]
    code, results, told = said(bare_python, "evaluate", skill, *quick)
    assert code == 0, told
    assert LEFT_OUT in told.splitlines() and results.startswith("starts") and (tmp_path / "page.html").exists()
