"""The web server that pages come from: on this machine only, on the port that was asked for."""

import contextlib
import io
import socket
from typing import Any

from .._errors import ConfigurationError, importing

ADDRESS = "127.0.0.1"


def open_server(port: int, label: str) -> Any:
    """A `viser.ViserServer` that listens on this machine alone; `port` 0 takes any that is free.

    **Raises** `ConfigurationError` for a port that is none or in use, `MissingDependencyError` without viser.
    """
    with importing("viser", "viewer"):
        import viser
    if not 0 <= port <= 65535:
        raise ConfigurationError(f"port is {port}, expected 0 (any free one) to 65535.")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((ADDRESS, port))
        except OSError as error:
            raise ConfigurationError(
                f"port {port} cannot be had: {error.strerror}. Is another viewer running? Choose another with --port, "
                "or --port 0 for any that is free."
            ) from error
        free = probe.getsockname()[1]
    with contextlib.redirect_stdout(io.StringIO()):  # it draws a box with its address; the command prints its own line
        server = viser.ViserServer(host=ADDRESS, port=free, label=label, verbose=False)
    if server.get_port() != free:  # viser takes the next port if somebody was quicker
        server.stop()
        raise ConfigurationError(f"port {free} was taken in this moment: try again, or choose another with --port.")
    return server
