"""Programs in C as libraries, which are kept: the C compiler is asked once for each."""

import functools
import hashlib
import os
import platform
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from .._unfinished import call, working_folder

_LONGEST = 300  # seconds that the C compiler may take


def library_of(text: str, flags: str, libraries: Sequence[str], include: Sequence[str] = (), depends: str = "") -> Path:
    """The library of a C program, in the folder that the environment variable `JAXRMP_CACHE` names.

    **Arguments**: `flags`, `libraries` and `include`, of the compiler; `depends`, what else decides what it makes.
    **Raises** `OSError` where there is none to be had, `subprocess.TimeoutExpired` if the compiler takes too long.
    """
    compiler, version = compiler_here()
    told = "\0".join((text, flags, *libraries, version, _processor(), depends))
    key = hashlib.sha256(told.encode()).hexdigest()[:32]
    folder = Path(os.environ.get("JAXRMP_CACHE") or "~/.cache/jaxrmp/c").expanduser()
    library = folder / f"{key}.so"
    if library.exists():
        return library
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    with working_folder(folder) as made:
        source, result = made / "program.c", made / "program.so"
        source.write_text(text)
        command = [compiler, *flags.split(), *include, str(source), "-o", str(result), *libraries]
        ran = call(command, made, _LONGEST)
        if ran.returncode:
            raise OSError(f"{' '.join(command[:3])} ...: {ran.stderr.strip()[-300:]}")
        os.replace(result, library)
    return library


@functools.cache
def compiler_here() -> tuple[str, str]:
    """The C compiler, by the environment variable `CC` or on the path, and what it calls itself."""
    found = shutil.which(os.environ.get("CC") or "cc") or shutil.which("gcc") or shutil.which("clang")
    if not found:
        raise OSError("there is no C compiler on the path (cc, gcc or clang), and CC names none.")
    return found, subprocess.run([found, "--version"], capture_output=True, text=True, check=False).stdout


def _processor() -> str:
    try:
        with open("/proc/cpuinfo") as file:
            return next((line for line in file if line.startswith(("flags", "Features"))), platform.processor())
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
