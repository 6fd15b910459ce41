"""The network of a command, loaded once in each process and run in one thread, so that bytes are equal."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from blur2view.batch.job import file_digest
from blur2view.cli.terminal import TileProgress
from blur2view.errors import RunError
from blur2view.networks.model_file import model_path, usable_cores
from blur2view.networks.smear_network import SmearNetwork


@dataclass(frozen=True, kw_only=True)
class CommandNetwork:
    """The file of the network, as it goes to the processes that run it.

    Parameters
    ----------
    model : str or None
        That of --model.
    digest : str
        SHA-256 of its file.
    """

    model: str | None
    digest: str

    @classmethod
    def of(cls, model: str | None) -> CommandNetwork:
        """Return those of --model, which is loaded to see that it can be; its tiles are shown to a person.

        Raises
        ------
        ModelError
            If it cannot.
        """
        path = model_path(model)
        digest = file_digest(path) if path.is_file() else ""
        network = _smears(model, digest)  # which says what is wrong, if anything is
        network.on_tile = TileProgress()
        network.tiles_at_once = usable_cores()  # here alone: other processes have a core each
        return cls(model=model, digest=digest)

    @property
    def loaded(self) -> SmearNetwork:
        """Return the smear network of this process.

        Raises
        ------
        RunError
            If another file has its name where this is run.
        """
        return _smears(self.model, self.digest)


@lru_cache(maxsize=1)
def _smears(model: str | None, digest: str) -> SmearNetwork:
    """Return the smear network of a file with this digest."""
    network = SmearNetwork(model, threads=1)
    if file_digest(network.path) != digest:  # as a machine of a cluster may have
        raise RunError(f"{network.path}: is another network on a worker; install the same blur2view there")
    return network
