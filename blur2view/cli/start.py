"""The process of the command line: its streams and environment, and how it ends."""

import atexit
import os
import sys
import threading
import warnings
from signal import SIG_IGN, SIGINT, signal

from blur2view.errors import address_space_mib, system_error

# MiB of address space, which `ulimit -v` may limit: no command works with less, and of 385 to 640 OpenBLAS or
# the loader end the process without a line, or it hangs
LEAST_MIB = 700
# commands that read photographs by a network, and words with which it is not the shipped one, or none
NETWORK_COMMANDS = {"estimate", "segment", "to-colmap", "recover", "reconstruct", "report", "triage"}
NOT_SHIPPED = "-h", "--help", "--model", "--provider"


def start() -> int:
    """Prepare the process, run the command line, and return its exit code, unless the process ends here."""
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
    if address_space_mib() < LEAST_MIB:
        print(f"blur2view: {system_error(MemoryError())}", file=sys.stderr)
        return 1
    opening = None
    try:
        opening = begin_to_open_network(sys.argv[1:])
        from blur2view.cli.commands import main
        from blur2view.cli.terminal import INTERRUPTED

        code = main()
        tools = getattr(sys, "monitoring", None)  # of Python 3.12, by which its profiler watches
        watched = sys.getprofile() or sys.gettrace() or (tools and any(map(tools.get_tool, range(6))))
        if code == INTERRUPTED or not (watched or any(not one.daemon for one in threading.enumerate()[1:])):
            leave(code, finish=code != INTERRUPTED)  # a network may run in its thread: nobody waits for it
    except (ImportError, MemoryError) as error:  # during an import as well; too little memory may cause it
        print(f"blur2view: {system_error(error)}", file=sys.stderr)
        code = 1
    if opening is not None:
        opening.join()  # the interpreter's end would abort the process while a network is opened
    return code


def begin_to_open_network(words: list[str]) -> threading.Thread | None:
    """Open the shipped network in a thread, if a command line will ask for it, beside all other imports."""
    needs_network = bool(words) and words[0] in NETWORK_COMMANDS and "_ARGCOMPLETE" not in os.environ
    if needs_network and not any(word.startswith(NOT_SHIPPED) for word in words):
        import cv2  # noqa: F401  not in two threads at once: for an instant its import shows half of it

        from blur2view.networks.ahead import open_ahead

        return open_ahead()
    return None


def leave(code: int, *, finish: bool) -> None:
    """End the process at once: to take down what its libraries hold would take a tenth of a second."""
    signal(SIGINT, SIG_IGN)
    if finish:
        atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code)
