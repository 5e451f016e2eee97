"""Every extra in an environment of its own: installed from this folder, imported, and put to its smallest use.

    python tests/extras/each_alone.py FOLDER [EXTRA ...]

It makes an environment for each in FOLDER, and is no part of `make test`: `make extras` takes half an
hour.
"""

import os
import signal
import subprocess
import sys
import time
import venv
from pathlib import Path

HERE = Path(__file__).parents[2]
MODELS = HERE / "tests" / "kinematics" / "models"
QUICK = ["--method", "paper", "--metric.updates=100", "--potential.widths=[0.05]", "--potential.basin_starts=100"]
SKILL, OUT = "{skill}", "{out}"
LEAST_RUN = ["run", SKILL, "--scene", "drawer", "--trials", "1", "--limit", "0.5", "--json", f"{OUT}/run.json"]
LEAST_EVALUATION = ["evaluate", SKILL, "--starts", "8", "--duration", "0.2", "--dt", "0.02", "--html", f"{OUT}/e.html"]
LEARN = ["learn", "configs/drawer_closing.toml", *QUICK, "--out", f"{OUT}/learned"]

# Of each extra, commands of jaxrmp, or programs in Python, that have to succeed. The first writes the skill that others
# use.
USES: dict[str, list[list[str] | str]] = {
    "learning": [LEARN, ["check", "configs/drawer_closing.toml"], ["completion", "bash"]],
    "": [
        "import jaxrmp, numpy as np; jaxrmp.acceleration(jaxrmp.leaves.Damping(), np.zeros(2), np.ones(2))",
        LEAST_EVALUATION,
    ],
    "learning,simulation": [LEARN, LEAST_RUN, [*LEAST_EVALUATION, "--physics", "mjx", "--dt", "0.001", "--batch", "8"]],
    "robots": [["check", str(MODELS / "six_axis.urdf")], [*LEAST_EVALUATION, "--physics", "mujoco", "--dt", "0.001"]],
    "formats": [
        "import yaml, pyarrow, rosbags, h5py; from jaxrmp.kinematics import load_robot; "
        f"load_robot({str(MODELS / 'six_axis.urdf')!r})"
    ],
    "simulation": [LEAST_RUN, [*LEAST_EVALUATION, "--physics", "mjx", "--dt", "0.001", "--batch", "8"]],
    "plots": [LEAST_EVALUATION, ["reproduce", SKILL, "--duration", "0.5", "--figures", f"{OUT}/figures"]],
    "export": [["export", SKILL, "--stablehlo", f"{OUT}/skill.bin", "--c", f"{OUT}/c"]],
    "franka": ["import pylibfranka, rosbags, mujoco, jaxrmp.hardware"],
    "viewer": [["view", "--port", "0", "-q"]],
    "docs": [
        "import subprocess, sys; "
        "sys.exit(subprocess.run([sys.executable, '-m', 'mkdocs', 'build', '-q', '-d', '{out}/site']).returncode)"
    ],
    "torch": ["import torch, pytorch_kinematics"],
    "peers": ["import frax, jaxrmp"],
    "dev": ["import pytest, nbclient, playwright, filelock"],
    "all": [LEARN, [*LEAST_RUN, "--video", f"{OUT}/run.mp4", "--figures", f"{OUT}/figures"]],
}
ONLY = {"torch": (3, 11), "franka": (3, 12)}  # up to which Python there is one


def python_with(extra: str, folder: Path) -> Path:
    """The interpreter of an environment with that extra, which is made."""
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True, symlinks=True)
        what = f"{HERE}[{extra}]" if extra else str(HERE)
        install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-c", "constraints.txt"]
        subprocess.run([*install, "-e", what], check=True, cwd=HERE)
    return python


def used(python: Path, use: list[str] | str, out: Path, skill: Path) -> tuple[int, str]:
    """The exit code of a use, and what it said; a page is ended by Ctrl-C once it is there."""
    words = [use] if isinstance(use, str) else use
    words = [word.replace(OUT, str(out)).replace(SKILL, str(skill)) for word in words]
    command = [python, "-c", *words] if isinstance(use, str) else [python, "-m", "jaxrmp", *words]
    with subprocess.Popen(
        command, cwd=HERE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env={**os.environ}
    ) as process:
        said = ""
        if words[0] == "view":
            for line in process.stdout or ():
                said += line
                if "The page is at" in line:
                    process.send_signal(signal.SIGINT)
                    break
        said += process.communicate(timeout=900)[0]
    return process.returncode, said


def main(folder: Path, extras: list[str]) -> int:
    folder = folder.resolve()
    skill = folder / "learning-out" / "learned" / "drawer_closing.skill.npz"
    failed = []
    for extra in extras or USES:
        name = extra.replace(",", "-") or "base"
        if sys.version_info[:2] > ONLY.get(extra, sys.version_info[:2]):
            print(f"{name}: not for Python {sys.version_info.major}.{sys.version_info.minor}")
            continue
        python, out = python_with(extra, folder / name), folder / f"{name}-out"
        out.mkdir(exist_ok=True)
        for use in USES[extra]:
            began = time.monotonic()
            code, said = used(python, use, out, skill)
            about = use if isinstance(use, str) else f"jaxrmp {use[0]}"
            print(f"{name}: {about[:60]}: exit code {code}, {time.monotonic() - began:.0f} s", flush=True)
            left_out = [line for line in said.splitlines() if "not installed" in line]
            print("".join(f"    {line}\n" for line in (left_out if code == 0 else said.splitlines()[-15:])), end="")
            failed += [name] * bool(code)
    print(f"failed: {', '.join(failed)}" if failed else "all extras suffice")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
