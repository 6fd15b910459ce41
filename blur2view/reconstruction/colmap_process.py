"""A process of its own for what pycolmap does: Ctrl-C ends it at once, and it tells how far it is."""

from collections.abc import Callable
from typing import Any, NamedTuple

from blur2view.errors import RunError
from blur2view.processes import follow_parent, not_started, spawn_context

WATCH_S = 1.0  # at most between looks at how far the process is


class Told(NamedTuple):
    """How many parts a process has done so far."""

    done: int


def in_process(
    call: Callable[..., Any], *given: Any, watch: Callable[[int], None] = lambda told: None, **options: Any
) -> Any:
    """Return what a function returns that a process of its own runs: Ctrl-C, which pycolmap ignores, ends it.

    Meanwhile ``watch`` is called with what the function has told last (`tell`), or 0: when it tells anything,
    and at least every `WATCH_S`.
    RunError if the process dies, or cannot be started.
    """
    import pycolmap

    context = spawn_context()
    answers, answer = context.Pipe(duplex=False)
    process = context.Process(
        target=_answer, args=(answer, pycolmap.logging.minloglevel, call, given, options)
    )
    told = 0
    try:
        try:
            process.start()
        except OSError as error:
            raise not_started(error) from None
        answer.close()
        while True:
            if answers.poll(WATCH_S):
                result = answers.recv()
                if not isinstance(result, Told):
                    break
                told = result.done
            watch(told)
    except EOFError:
        remedy = "choose fewer frames with --frames"
        raise RunError(f"COLMAP's process died, perhaps because of too little memory; {remedy}") from None
    finally:
        if process.pid is not None:  # it has been started
            process.kill()
            process.join()
    if isinstance(result, Exception):
        raise result
    return result


def _answer(answer: Any, log_level: int, call: Callable[..., Any], given: Any, options: Any) -> None:
    """Send what a function returns or raises."""
    import pycolmap

    follow_parent()
    pycolmap.logging.minloglevel = log_level
    _PARENT[:] = [answer]
    try:
        answer.send(call(*given, **options))
    except Exception as error:  # of any type: it is raised where the call was asked for
        answer.send(error)


_PARENT: list[Any] = []  # the pipe to it, of a process that was started


def tell(done: int) -> None:
    """Tell the process that waits for this one how many parts are done."""
    for pipe in _PARENT:
        pipe.send(Told(done))
