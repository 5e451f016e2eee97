"""Functions of the benchmarks in processes of their own: other flags for XLA, other cores, nothing compiled before."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

_SCRIPT = """
import importlib, json, os, sys
where, cores, here, arguments = json.loads(sys.argv[1])
if cores:
    os.sched_setaffinity(0, cores)
if here:
    import jax
    jax.config.update("jax_cpu_enable_async_dispatch", False)
module, name = where.split(":")
found = getattr(importlib.import_module(module), name)(*arguments)
print("\\n" + json.dumps(found))
"""


def in_child(where: str, *arguments: Any, cores: set[int] | None = None, **variables: str) -> Any:
    """What `module:function` of `arguments` returns, both as JSON, in a fresh process with these variables set too.

    **Raises** `RuntimeError` with what the child printed, if it fails.
    """
    jax = sys.modules.get("jax")
    here = jax is not None and not jax.config.read("jax_cpu_enable_async_dispatch")  # as `stay_on_one_core` leaves it
    command = [sys.executable, "-c", _SCRIPT, json.dumps([where, sorted(cores or ()), here, arguments])]
    run = subprocess.run(command, env=environment_of(**variables), capture_output=True, text=True, check=False)
    if run.returncode:
        raise RuntimeError(f"{where}{arguments} failed in a child process:\n{run.stderr[-3000:]}")
    return json.loads(run.stdout.splitlines()[-1])


def environment_of(**variables: str) -> dict[str, str]:
    """This process's environment, with the benchmarks themselves on the path and these variables set too."""
    path = os.pathsep.join(filter(None, (str(Path(__file__).parent.parent), os.environ.get("PYTHONPATH"))))
    return {**os.environ, "PYTHONPATH": path, **variables}


def stay_on_one_core() -> None:
    """Keep this process on one of the cores it may use, the last, and what it computes in the thread that asks for it.

    To be called before JAX starts: docs/guides/robot_loop.md has a control loop begin so.
    """
    import jax

    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    jax.config.update("jax_cpu_enable_async_dispatch", False)
