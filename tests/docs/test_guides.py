"""CONTRIBUTING and the guides put to the test: their code runs, and does what they say."""

from pathlib import Path

import pytest

from .blocks import run_blocks

ROOT = Path(__file__).parents[2]
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
GUIDES = [*sorted((ROOT / "docs" / "guides").glob("*.md")), ROOT / "docs" / "policies.md", ROOT / "docs" / "drive.md"]


@pytest.mark.parametrize("path", GUIDES, ids=lambda p: p.stem)
def test_guides_code_runs(path):
    """What a guide says its code does, it asserts."""
    run_blocks(path.read_text(encoding="utf-8"), path.stem)


def test_contributing_leaf_passes_its_own_tests():
    namespace = run_blocks(CONTRIBUTING, "contributing")
    tests = [value for name, value in namespace.items() if name.startswith("test_")]
    assert len(tests) >= 6
    for test in tests:
        test()
