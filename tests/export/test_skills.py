"""A learned skill in C: the whole policy of the arm, as `jaxrmp export` writes it, against JAX."""

import subprocess
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import acceleration, certificate, export
from jaxrmp.cli import main
from jaxrmp.cli._export import skill_in_c
from jaxrmp.kinematics import panda
from jaxrmp.learning import learn, load_configuration, load_skill, save_skill
from jaxrmp.policies import goal_distance, whole_arm_policy
from jaxrmp.synthetic import synthetic_demonstrations
from jaxrmp.world import Spheres, World

from .calling import PRECISIONS, STRICT, TYPES, by_jax, compiled_c, in_precision, needs_compiler, within_rounding

CONFIG = Path(__file__).parents[2] / "configs" / "drawer_closing.toml"
FEW = {"method": "flow", "flow.updates": 200, "flow.couplings": 4, "flow.hidden": 16}
ROBOT = panda()
RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def skills(drawer_skill, once):
    """One by each method, learned with little work."""

    def make(folder):
        configuration = load_configuration(CONFIG, FEW)
        learned = learn(configuration, ROBOT, synthetic_demonstrations("drawer_closing"))
        save_skill(learned.skill, folder / "flow.skill.npz")

    flow = load_skill(once("drawer-flow-for-c", make) / "flow.skill.npz")
    assert flow.method == "flow" and drawer_skill.method == "paper"
    return {"flow": flow, "paper": drawer_skill}


@needs_compiler
@PRECISIONS
@pytest.mark.parametrize("method", ["flow", "paper"])
def test_whole_arm(method, precision, skills, tmp_path):
    skill, real = skills[method], TYPES[precision]
    found = skill_in_c(skill, ROBOT, obstacles=2, certificate=True, precision=precision)
    assert len(found.source.encode()) < 1e6
    middle = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    q, qd = middle + 0.3 * RNG.normal(size=(1000, 7)), 0.3 * RNG.normal(size=(1000, 7))
    T = np.array(skill.T_world_object)
    spheres = Spheres.of([((0.5, 0.1, 0.5), 0.05)], capacity=2)
    fixed = jax.tree.map(lambda a: np.asarray(a, bool if np.asarray(a).dtype == bool else real), (T, spheres))
    states = [a.astype(real) for a in (q, qd)]

    def expected(T, spheres, q, qd):
        whole = jax.tree.map(
            lambda a: jnp.asarray(a, bool if a.dtype == bool else real), whole_arm_policy(skill, ROBOT)
        )
        tree = whole.tree(T, World(spheres=spheres))
        seen = certificate(tree, q, qd)
        return seen.energy, seen.dissipation, goal_distance(whole, q, T), acceleration(tree, q, qd)

    with in_precision(precision):
        wanted = by_jax(expected, fixed, states)
    given = compiled_c(found, tmp_path)(*states, *fixed)
    assert within_rounding(given, wanted, expected, precision, fixed, states)


@needs_compiler
def test_the_command_writes_what_builds_and_comes_to_rest_where_jax_does(skills, tmp_path, capsys):
    save_skill(skills["flow"], tmp_path / "drawer.skill.npz")
    out = tmp_path / "c"
    command = ["export", str(tmp_path / "drawer.skill.npz"), "--c", str(out), "--certificate", "--while-count", "9"]
    assert main([*command, "--demos", "synthetic:drawer_closing", "--quiet"]) == 0
    assert {f.name for f in out.iterdir()} == {
        *("drawer_closing.c", "drawer_closing.h"),
        *("CMakeLists.txt", "main.c", "example.cpp"),
    }
    printed = capsys.readouterr().out
    assert "drawer_closing.c, drawer_closing.h" in printed
    fingerprint = printed.split("fingerprint ")[1].split()[0]
    assert f'DRAWER_CLOSING_FINGERPRINT "{fingerprint}"' in (out / "drawer_closing.h").read_text()
    assert "int32_t bound_hit;" in (out / "drawer_closing.h").read_text()
    sources = [str(out / name) for name in ("drawer_closing.c", "main.c")]
    subprocess.run(["gcc", *STRICT.split(), "-O2", *sources, "-o", str(out / "main"), "-lm"], check=True)
    ran = subprocess.run([str(out / "main")], capture_output=True, text=True, check=True).stdout
    assert "us a call" in ran and "dissipation" in ran
    assert 0 <= float(ran.split("goal_distance ")[1].split()[0]) < 0.002
    at_rest = np.array(ran.split(" at ")[1].split("\n")[0].split(), np.float32)
    tree = whole_arm_policy(skills["flow"], ROBOT).tree(skills["flow"].T_world_object, World())
    assert float(jnp.abs(acceleration(tree, at_rest, np.zeros(7, np.float32))).max()) < 0.05
    assert float(tree.energy(at_rest, np.zeros(7, np.float32))) < 1e-3


def test_what_the_command_refuses(skills, tmp_path, capsys):
    save_skill(skills["paper"], tmp_path / "drawer.skill.npz")
    command = ["export", str(tmp_path / "drawer.skill.npz"), "--c", str(tmp_path / "c")]
    capsys.readouterr()
    assert main([*command, "--obstacles", "-1"]) == 1
    assert "--obstacles is -1, expected 0 or more" in capsys.readouterr().err
    assert main([*command, "--obstacles", "2000", "--certificate", "--quiet"]) == 1
    assert "Say fewer --obstacles than 2000 or no --certificate." in capsys.readouterr().err
    assert main([*command, "--demos", str(tmp_path / "nowhere"), "--quiet"]) == 1
    assert not (tmp_path / "c").exists()
    assert main(command[:2]) == 1
    assert "--c DIR, --stablehlo FILE, or both" in capsys.readouterr().err
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "CMakeLists.txt").write_text("project(mine)")
    assert main([*command, "--demos", "synthetic:drawer_closing", "--quiet"]) == 1
    assert "CMakeLists.txt is there and was not written by jaxrmp" in capsys.readouterr().err
    assert [f.name for f in (tmp_path / "c").iterdir()] == ["CMakeLists.txt"]


@needs_compiler
def test_the_program_says_when_the_policy_gives_no_number(tmp_path):
    q = np.ones(2, np.float32)
    found = export.c(lambda q, qd: {"qdd": jnp.sqrt(-1 - q * q) + qd}, q, q, name="rootless")
    export.write_project(found, {"q": q}, "nowhere", tmp_path)
    command = ["gcc", *STRICT.split(), "-O2", str(tmp_path / "rootless.c"), str(tmp_path / "main.c"), "-lm"]
    subprocess.run([*command, "-o", str(tmp_path / "main")], check=True)
    ran = subprocess.run([str(tmp_path / "main")], capture_output=True, text=True, check=False)
    assert ran.returncode == 1 and "not a number" in ran.stdout
