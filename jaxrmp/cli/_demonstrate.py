"""`jaxrmp demonstrate`: write the scripted demonstrator's demonstrations to a folder."""

import argparse

from .._counted import counted
from ..synthetic import write_synthetic_demonstrations


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    write_synthetic_demonstrations(
        arguments.task, arguments.out, seed=arguments.seed, count=arguments.count, overwrite=arguments.overwrite
    )
    print(f"wrote {counted(arguments.count, 'demonstration')} of {arguments.task} to {arguments.out}")
