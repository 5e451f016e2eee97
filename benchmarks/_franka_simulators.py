"""Simulators of a Franka that speak its network protocol, each a process of its own (`make simulators`)."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(os.environ.get("JAXRMP_SIMULATORS") or Path(__file__).parents[1] / ".simulators")
FRANKY, STRICT = ROOT / "franky" / "bin" / "franky-sim", ROOT / "strict" / "bin" / "run-franka-sim-server"
NAMES = ("franky-sim", "franka-sim")
_PORT = 1337
_PATIENCE = 60.0  # seconds until it must listen


class Simulator:
    """A running one: `host`, where it listens; its `process`; `log`, what it printed so far."""

    def __init__(self, host: str, process: subprocess.Popen, log: Path):
        self.host, self.process, self._file = host, process, log

    @property
    def log(self) -> str:
        return self._file.read_text(errors="replace")

    @property
    def violations(self) -> list[str]:
        """What the strict one ended motions for, or would have; franky-sim knows no limits."""
        return re.findall(r"motion limit violated: .*|communication_constraints_violation.*", self.log)


def missing(name: str) -> str:
    """Why the simulator cannot run here; empty if it can."""
    program = FRANKY if name == "franky-sim" else STRICT
    if not program.exists():
        return f"{name} is not installed: make simulators"
    if name == "franka-sim" and not (ROOT / "fr3.xml").exists():
        return f"{ROOT / 'fr3.xml'} is not there: make simulators"
    if sys.platform != "linux":
        return "pylibfranka runs on Linux"
    return ""


@contextlib.contextmanager
def simulator(name: str, folder: Path, options: Sequence[str] = (), script: Path | None = None) -> Iterator[Simulator]:
    """Start one and wait until it listens; it is ended with the block.

    **Arguments**: `folder`, for what it prints; `options`, more of its command line; `script`, a Python program to run
    in franky-sim's environment in place of its own, with the address to listen at as its argument.
    """
    host = "127.0.0.1"
    if name == "franky-sim":
        command = [str(FRANKY.parent / "python"), str(script), host] if script else [str(FRANKY), "--hostname", host]
        command += ["--simulator", "mujoco"] if script is None else []
    else:
        command = [str(STRICT)]
    log = folder / f"{name}.log"
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "FR3_MJCF": str(ROOT / "fr3.xml")}
    with open(log, "w") as file:
        process = subprocess.Popen([*command, *options], stdout=file, stderr=subprocess.STDOUT, env=environment)
    try:
        _wait(host, process, log)
        yield Simulator(host, process, log)
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal.SIGCONT)
        process.terminate()
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _wait(host: str, process: subprocess.Popen, log: Path) -> None:
    until = time.monotonic() + _PATIENCE
    while time.monotonic() < until:
        if process.poll() is not None:
            raise RuntimeError(f"the simulator ended: {log.read_text(errors='replace')[-2000:]}")
        if _listens():
            time.sleep(1.0)  # a simulator that serves one client at a time lets go of the one that asked
            return
        time.sleep(0.2)
    raise RuntimeError(f"the simulator did not listen: {log.read_text(errors='replace')[-2000:]}")


def _listens() -> bool:
    """Whether something listens, by the kernel's table: asking would be taken for a client."""
    rows = Path("/proc/net/tcp").read_text().splitlines()[1:]
    return any(row.split()[1].endswith(f":{_PORT:04X}") and row.split()[3] == "0A" for row in rows)
