"""What every photograph needs of the shipped networks, made beside the program's start."""

from contextlib import suppress
from threading import Thread

from blur2view.networks.model_file import SMEAR, Execution, shipped


def open_ahead() -> None:
    """Open the shipped smear network and make its tables in a thread, which nothing waits for."""
    Thread(target=_open, daemon=True).start()


def _open() -> None:
    with suppress(Exception):  # raised again where the network is asked for
        shipped(SMEAR, Execution())
        from blur2view.networks.spectra import polar_map

        polar_map()
