"""What every photograph needs of the shipped networks, made beside the program's start."""

from contextlib import suppress
from threading import Thread

from blur2view.networks.model_file import SMEAR, Execution, shipped


def open_ahead() -> Thread:
    """Open the shipped smear network and make its tables in a thread, which is returned."""
    opening = Thread(target=_open, daemon=True)
    opening.start()
    return opening


def _open() -> None:
    with suppress(Exception):  # raised again where the network is asked for
        shipped(SMEAR, Execution())
        from blur2view.networks.spectra import polar_map

        polar_map()
