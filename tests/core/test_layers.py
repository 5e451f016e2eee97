"""The layers hold: what importing jaxrmp brings, and who may import whom."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import jaxrmp

PACKAGE = Path(jaxrmp.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
OPTIONAL = [
    "flax",
    "optax",
    "mujoco",
    "cvxpy",
    "matplotlib",
    "torch",
    "scipy",
    "viser",
    "trimesh",
    "playwright",
    "tqdm",
    "shtab",
    "mediapy",
    "imageio",
    "imageio_ffmpeg",
    "yaml",
    "pyarrow",
    "h5py",
    "rosbags",
    "flatbuffers",
    "pylibfranka",
    "gymnasium",
]
BY_JAX = {"scipy", "flatbuffers"}  # which it imports itself, where they are installed

# Which third-party packages a module may import as it is imported; all others only inside functions.
ALWAYS = {"jax", "numpy"}
OWNERS = {
    "learning/_initial_weights.py": {"flax"},
    "environments/_gymnasium.py": {"gymnasium"},
}
OWNING_PARTS = {"synthetic": {"scipy"}, "visualization": {"matplotlib", "mpl_toolkits"}}
LAZY_IN_CORE = {"kinematics/_mujoco.py": {"mujoco"}, "kinematics/_meshes.py": {"trimesh"}}

# Which parts of jaxrmp a part may import, itself, the core (`jaxrmp/*.py`) and the machinery below it aside.
LAYERS = {
    "xla": set(),
    "core": {"leaves", "kinematics", "inspection", "world"},  # for re-export by jaxrmp/__init__.py, checked below
    "leaves": set(),
    "kinematics": set(),
    "world": {"kinematics"},
    "inspection": set(),
    "policies": {"leaves", "kinematics", "world"},
    "io": {"kinematics", "leaves", "world"},
    "perception": {"kinematics", "world"},
    "scenes": {"kinematics", "world"},
    "simulation": {"inspection", "kinematics", "leaves", "scenes", "world"},
    "learning": {"leaves", "kinematics", "simulation", "world"},
    "sequences": {"inspection", "kinematics", "learning", "policies", "scenes", "simulation", "world"},
    "environments": {"kinematics", "policies", "simulation", "world"},
    "synthetic": {"kinematics", "learning"},
    "hardware": {"kinematics", "policies", "scenes", "simulation", "world"},
    "reports": set(),
    "export": set(),
    "evaluation": {"leaves", "kinematics", "learning", "policies", "reports", "scenes", "simulation", "world"},
    "visualization": {"evaluation", "inspection", "leaves", "kinematics", "learning", "scenes", "simulation"},
    "viewer": {
        "inspection",
        "kinematics",
        "leaves",
        "learning",
        "perception",
        "policies",
        "scenes",
        "simulation",
        "world",
    },
    "cli": {
        "evaluation",
        "export",
        "hardware",
        "io",
        "leaves",
        "perception",
        "kinematics",
        "learning",
        "policies",
        "reports",
        "scenes",
        "sequences",
        "simulation",
        "synthetic",
        "viewer",
        "visualization",
        "world",
    },
}


def name_of(path):
    return path.relative_to(PACKAGE).as_posix()


def part_of(parts):
    """The layer of a module given by its path below the package, without `.py`."""
    return parts[0] if parts and (PACKAGE / parts[0]).is_dir() else "core"


def imports(path):
    """(is it at module level, absolute dotted name) of every import in a file, those under try at its top included."""
    tree = ast.parse(path.read_text())
    inside = {id(node) for f in ast.walk(tree) if isinstance(f, ast.FunctionDef | ast.Lambda) for node in ast.walk(f)}
    for node in ast.walk(tree):
        top = id(node) not in inside
        if isinstance(node, ast.Import):
            yield from ((top, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield top, node.module
        elif isinstance(node, ast.ImportFrom):
            here = ["jaxrmp", *path.relative_to(PACKAGE).parts][: -node.level]
            base = [*here, *(node.module.split(".") if node.module else [])]
            for alias in node.names:
                yield top, ".".join([*base, alias.name])


def test_importing_jaxrmp_is_quiet_light_and_changes_nothing():
    program = f"""
import sys, jax
before = dict(jax.config.values)
loaded = set(sys.modules)
import jaxrmp
new = {{name.split(".")[0] for name in set(sys.modules) - loaded}}
assert not new & set({OPTIONAL}), new & set({OPTIONAL})
assert not set(sys.modules) & set({[n for n in OPTIONAL if n not in BY_JAX]})
changed = {{k for k, v in jax.config.values.items() if before.get(k) != v}}
assert not changed, changed
assert not jax._src.xla_bridge._backends, "importing did work on a device"
"""
    run = subprocess.run(
        [sys.executable, "-c", program], check=False, capture_output=True, text=True, cwd=PACKAGE.parent, timeout=120
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout == "" and run.stderr == ""


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_a_module_imports_only_what_its_layer_may(path):
    part = "cli" if path.name == "__main__.py" else part_of(path.relative_to(PACKAGE).with_suffix("").parts)
    allowed = ALWAYS | OWNERS.get(name_of(path), set()) | OWNING_PARTS.get(part, set())
    for top, imported in imports(path):
        root, *below = imported.split(".")
        if root == "jaxrmp":
            target = part_of(below)
            if target != part:
                expected = {"core", "xla", *LAYERS[part]}
                assert target in expected, f"{name_of(path)} imports {imported}; {part} may import {sorted(expected)}"
            if part == "xla" and target == "core":
                assert below[0] in ("_errors", "_unfinished"), (
                    f"{name_of(path)} imports {imported}; it is below the core"
                )
            if part == "core" and target not in ("core", "xla"):
                assert name_of(path) == "__init__.py", f"{name_of(path)} imports {imported}"
        elif root not in sys.stdlib_module_names:
            if top:
                assert root in allowed, f"{name_of(path)} imports {imported} at module level"
            elif part in ("core", "leaves", "kinematics", "xla"):
                assert root in allowed | LAZY_IN_CORE.get(name_of(path), set()), f"{name_of(path)} imports {imported}"


def test_the_walk_sees_the_imports_it_judges():
    seen = {(top, name) for path in MODULES for top, name in imports(path)}
    assert (True, "jaxrmp._pytree.pytree") in seen
    assert (True, "flax.linen") in seen
    assert (False, "mujoco") in seen and (True, "mujoco") not in seen


def test_parts_that_need_optional_packages_are_there_on_first_use():
    parts = {p.name for p in PACKAGE.iterdir() if p.is_dir() and any(p.glob("*.py"))}
    lazy = parts - LAYERS["core"] - {"xla", "reports", "cli"}  # always there; and not for import
    program = f"""
import sys, jaxrmp
assert set({sorted(lazy)}) <= set(dir(jaxrmp)) and not any("jaxrmp." + name in sys.modules for name in {sorted(lazy)})
assert jaxrmp.learning.load_skill is sys.modules["jaxrmp.learning"].load_skill
assert jaxrmp.policies.damping().weight == 0.02
for name in {sorted(lazy)}:
    getattr(jaxrmp, name)
import jax
assert not jax._src.xla_bridge._backends, "importing did work on a device, and jax.distributed must come before that"
try:
    jaxrmp.lerning
except AttributeError as error:
    assert "'jaxrmp' has no attribute 'lerning'" in str(error)
else:
    raise AssertionError("a name that is not there")
"""
    run = subprocess.run(
        [sys.executable, "-c", program], check=False, capture_output=True, text=True, cwd=PACKAGE.parent
    )
    assert run.returncode == 0, run.stderr


def test_every_part_has_a_layer():
    assert {p.name for p in PACKAGE.iterdir() if p.is_dir() and any(p.glob("*.py"))} <= set(LAYERS)


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_files_are_short_and_named_after_an_idea(path):
    lines = len(path.read_text().splitlines())
    assert lines <= 400, f"{name_of(path)} has {lines} lines; split it at an idea"
    assert path.stem.strip("_") not in {"util", "utils", "helpers", "misc", "common"}


def test_nobody_but_the_tree_asks_of_what_kind_a_node_is():
    """What walks over a tree is a `Visitor`: a new kind of node is evaluated, inspected and held by its `accept`."""
    asked = re.compile(r"isinstance\([^)]*\b(Sum|Pullback|Batched|Scaled)\b")
    found = [name_of(path) for path in MODULES if asked.search(path.read_text())]
    assert found == ["_tree.py"]


def test_nothing_compares_the_names_of_scenes():
    """They are looked up by name in one place, and bring what is special about them."""
    compared = re.compile(r"\b(scene|place)\.name\s*(==|!=|in)\b|[=!]= *[\"'](drawer|door)")
    assert [name_of(path) for path in MODULES if compared.search(path.read_text())] == []
