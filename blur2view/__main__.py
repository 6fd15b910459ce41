"""The program, ``blur2view`` and ``python -m blur2view``, which answers Ctrl-C from here on."""

import _signal  # type: ignore[import-not-found]  # signal itself imports enum: 9 ms without an answer
import _thread
import os
import sys
import time
from types import FrameType

AGAIN_S = 0.01  # after which Ctrl-C is pressed anew, if a finalizer has swallowed it


def program() -> int:
    """Return the exit code of the command line in a process of its own, where nobody else prints."""
    if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:  # not ignored, as in the background
        _signal.signal(_signal.SIGINT, interrupt)
        sys.unraisablehook = unraised
    try:
        from blur2view.cli.start import start

        return start()
    except KeyboardInterrupt:  # before or after the command
        end_interrupted()
        raise


def interrupt(number: int, frame: FrameType | None) -> None:
    """Answer Ctrl-C by KeyboardInterrupt or, during an import, which may lose it, by the process's end."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            end_interrupted()
        if frame.f_code is unraised.__code__:  # which would lose it as well
            _thread.start_new_thread(press_again, ())
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def unraised(unraisable: "sys.UnraisableHookArgs") -> None:
    """Print an exception that no caller gets, as of a finalizer; of Ctrl-C, press it again a little later."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        _thread.start_new_thread(press_again, ())
    else:
        sys.__unraisablehook__(unraisable)


def press_again() -> None:
    """Interrupt the main thread once more, which has left the finalizer by then."""
    time.sleep(AGAIN_S)
    os.kill(os.getpid(), _signal.SIGINT)


def end_interrupted() -> None:
    """End the process with a line; what is half written the next call removes."""
    try:
        sys.stdout.flush()
        print("blur2view: interrupted", file=sys.stderr, flush=True)
    finally:
        os._exit(128 + _signal.SIGINT)


if __name__ == "__main__":
    sys.exit(program())
