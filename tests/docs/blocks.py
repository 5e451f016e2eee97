"""The code in documents, and what running it gives."""

import re

import jax


def code_blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def run_blocks(text: str, name: str) -> dict:
    """Run all Python blocks of a text one after the other in one namespace, as a reader would, and return it."""
    namespace: dict = {"__name__": name}
    inline = "jax_cpu_enable_async_dispatch"  # which a control loop switches off for its whole process
    before = jax.config.read(inline)
    try:
        for number, block in enumerate(code_blocks(text, "python")):
            exec(compile(block, f"{name}, block {number}", "exec"), namespace)
    finally:
        jax.config.update(inline, before)
    return namespace
