"""The program: ``blur2view`` and ``python -m blur2view``."""

import atexit
import os
import sys
import threading
import warnings
from contextlib import suppress

# MiB of address space, which `ulimit -v` may limit: no command works with less, and of 385 to 640 OpenBLAS or
# the loader end the process without a line, or it hangs
LEAST_MIB = 700
INTERRUPTED = 130  # exit code
# commands that read photographs by a network, and words with which it is not the shipped one, or none
NETWORK_COMMANDS = {"estimate", "segment", "to-colmap", "recover", "reconstruct", "report", "triage"}
NOT_SHIPPED = "-h", "--help", "--model", "--provider"


def address_space_mib() -> float:
    """Return how much address space this process may have, MiB; infinite where the system has no limit."""
    try:
        import resource
    except ImportError:
        return float("inf")
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return float("inf") if limit == resource.RLIM_INFINITY else limit / 2**20


def program() -> int:
    """Return the exit code of the command line in a process of its own, where nobody else prints."""
    opening = None
    try:
        for name in ("stdin", "stdout", "stderr"):
            if getattr(sys, name) is None:  # closed: the next file that opens would take its place
                setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), "r" if name == "stdin" else "w"))
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ.setdefault(name, "1")  # NumPy reads them on import, and sums depend on them
        os.environ.setdefault("GLOG_logtostderr", "1")  # pycolmap leaves no log files in the temporary folder
        if not sys.warnoptions:
            warnings.simplefilter("ignore")
        # libpng, libtiff and OpenCV print to 2 without naming a file; our own lines go where 2 led
        sys.stderr = os.fdopen(os.dup(2), "w", buffering=1, errors="backslashreplace")
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        if (limit := address_space_mib()) < LEAST_MIB:
            print(
                f"blur2view: an address space of {limit:.0f} MiB is too little; allow more with ulimit -v",
                file=sys.stderr,
            )
            return 1
        opening = begin_to_open_network(sys.argv[1:])
        from blur2view.cli.commands import main

        code = main()
        tools = getattr(sys, "monitoring", None)  # of Python 3.12, by which its profiler watches
        watched = sys.getprofile() or sys.gettrace() or (tools and any(map(tools.get_tool, range(6))))
        if code == INTERRUPTED or not (watched or any(not one.daemon for one in threading.enumerate()[1:])):
            leave(code)  # a network may still run in its thread, and nobody waits for it
        return code
    except KeyboardInterrupt:  # during an import
        print("blur2view: interrupted", file=sys.stderr)
        leave(INTERRUPTED)
        return INTERRUPTED
    except (ImportError, MemoryError) as error:  # during an import as well; too little memory may cause it
        reason = " ".join(str(error).split()) or "too little memory"
        print(
            f"blur2view: a library cannot be loaded ({reason}); free memory, or install it again",
            file=sys.stderr,
        )
        return 1
    finally:
        if opening is not None:
            with suppress(KeyboardInterrupt):
                opening.join()  # the interpreter's end would abort the process while a network is opened


def begin_to_open_network(words: list[str]) -> threading.Thread | None:
    """Open the shipped network in a thread, if a command line will ask for it, beside all other imports."""
    asked = bool(words) and words[0] in NETWORK_COMMANDS and "_ARGCOMPLETE" not in os.environ
    if asked and not any(word.startswith(NOT_SHIPPED) for word in words):
        import cv2  # noqa: F401  not in two threads at once: for an instant its import shows half of it

        from blur2view.networks.ahead import open_ahead

        return open_ahead()
    return None


def leave(code: int) -> None:
    """End the process at once: to take down what its libraries hold would take a tenth of a second."""
    if code != INTERRUPTED:
        atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code)


if __name__ == "__main__":
    sys.exit(program())
