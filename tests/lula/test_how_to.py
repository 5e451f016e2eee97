"""The how-to for Lula's users runs as it is written, on NVIDIA's published files."""

import re
from pathlib import Path

import numpy as np

from jaxrmp.io import LulaPolicy

TEXT = (Path(__file__).parents[2] / "docs" / "lula.md").read_text(encoding="utf-8")


def test_its_code_runs_and_is_traced_once(folder, monkeypatch, capsys):
    traces, build = [], LulaPolicy.tree

    def counted(policy, **targets):
        traces.append(1)
        return build(policy, **targets)

    monkeypatch.setattr(LulaPolicy, "tree", counted)
    monkeypatch.chdir(folder)
    shared: dict = {"__name__": "how_to"}
    for block in re.findall(r"^```python\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL):
        exec(compile(block, "docs/lula.md", "exec"), shared)
    assert "cspace_trajectory_rmp" in capsys.readouterr().out
    assert shared["q"].shape == (7,) and np.isfinite(shared["q"]).all() and np.abs(shared["qd"]).max() > 0
    assert len(traces) == 1
