"""`jaxrmp demonstrate`: write the scripted demonstrator's demonstrations to a folder."""

import argparse

from ..synthetic import write_synthetic_demonstrations


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    write_synthetic_demonstrations(
        arguments.task, arguments.out, seed=arguments.seed, count=arguments.count, overwrite=arguments.overwrite
    )
    print(f"wrote {arguments.count} demonstrations of {arguments.task} to {arguments.out}")
