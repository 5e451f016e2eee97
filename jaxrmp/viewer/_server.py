"""The web server that pages come from: on this machine only, unless a password stands before it."""

import contextlib
import io
import ipaddress
import socket
from typing import Any, NamedTuple

from .._errors import ConfigurationError, importing
from ._guard import Guard

ADDRESS = "127.0.0.1"
_LEAST = 8  # characters of a password


class Access(NamedTuple):
    """Who may see a page: `host`, the address that it listens at, and `password`, None for none, which only an address
    of this machine alone may have."""

    host: str = ADDRESS
    password: str | None = None

    @property
    def local(self) -> bool:
        """Whether this machine alone can reach it."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def name(self) -> str:
        """What the page's address calls the host: this machine's name where it listens at all of its addresses."""
        if self.host in ("0.0.0.0", "::"):
            return socket.gethostname()
        return f"[{self.host}]" if ":" in self.host else self.host

    def check(self) -> None:
        """**Raises** `ConfigurationError` for an address that others can reach without a password, or a short one."""
        if self.password is None and not self.local:
            raise ConfigurationError(
                f"--host {self.host}: whoever can reach that address could move the arm on the page. Give --password, "
                "or leave --host out and use a tunnel: ssh -L 8080:127.0.0.1:8080 THIS_MACHINE."
            )
        if self.password is not None and len(self.password) < _LEAST:
            raise ConfigurationError(f"--password has {len(self.password)} characters, expected {_LEAST} at least.")


class Opened(NamedTuple):
    """A `viser.ViserServer`, the `guard` before it, if any, and the `port` that people use."""

    server: Any
    guard: Guard | None
    port: int

    def stop(self) -> None:
        """Listen no more."""
        if self.guard is not None:
            self.guard.stop()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


def open_server(port: int, label: str, access: Access | None = None) -> Opened:
    """A server that listens on this machine alone, or behind a password where `access` says; `port` 0 takes any that
    is free.

    **Raises** `ConfigurationError` for a port that is none or in use, or access for everybody;
    `MissingDependencyError` without viser.
    """
    access = access or Access()
    access.check()
    with importing("viser", "viewer"):
        import viser
    if not 0 <= port <= 65535:
        raise ConfigurationError(f"port is {port}, expected 0 (any free one) to 65535.")
    direct = access.password is None
    free = _free(access.host if direct else ADDRESS, port if direct else 0)
    with contextlib.redirect_stdout(io.StringIO()):  # it draws a box with its address; the command prints its own line
        server = viser.ViserServer(host=access.host if direct else ADDRESS, port=free, label=label, verbose=False)
    if server.get_port() != free:  # viser takes the next port if somebody was quicker
        server.stop()
        raise ConfigurationError(f"port {free} was taken in this moment: try again, or choose another with --port.")
    if access.password is None:
        return Opened(server, None, free)
    try:
        guard = Guard(access.host, port, free, access.password)
    except OSError as error:
        server.stop()
        raise _taken(access.host, port, error) from error
    return Opened(server, guard, guard.port)


def _free(host: str, port: int) -> int:
    """The port, if it can be had, or any for 0."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise _taken(host, port, error) from error
        return probe.getsockname()[1]


def _taken(host: str, port: int, error: OSError) -> ConfigurationError:
    at = "" if host == ADDRESS else f" at {host}"
    return ConfigurationError(
        f"port {port}{at} cannot be had: {error.strerror}. Is another viewer running? Choose another with --port, "
        "or --port 0 for any that is free."
    )
