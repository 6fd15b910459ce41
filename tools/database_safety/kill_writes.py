"""Kill a process with SIGKILL at a random moment of a write, many times, and look at the database afterwards.

    python -m tools.database_safety.kill_writes --count 1000

Every trial copies a project, lets a child write views into it (or a fresh database, or replace views) and
kills it after a random share of the time such a write takes. Kinds alternate: rollback journals, write-ahead
logs, with a backup, while another program reads, with a second writer at work, on a disk that is full instead
of a kill, in projects that were edited by hand, and fresh.

The database must then be whole and as before or as after a whole write (of either writer, or of both); the
user's rows must be the same, and it must be possible to link all photographs again.
"""

import os
import resource
import shutil
import signal
import sqlite3
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations
from pathlib import Path

import numpy as np

from blur2view.colmap.database import write_database
from blur2view.colmap.link import LinkStep, plan_links, write_links
from blur2view.errors import DatabaseError
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.two_view_geometry import Configuration, TimeDirection, TwoViewGeometry
from tools.arguments import parser_of
from tools.database_safety.colmap_check import check_database
from tools.database_safety.colmap_projects import ProjectOptions, make_project, user_rows

IMAGES, FEATURES = 3, 500
Write = Callable[[Path], object]
KINDS = (
    "link", "link wal", "link wal backup", "replace", "replace wal", "link wal, reader", "link, two writers",
    "link wal, two writers", "link, full disk", "link wal backup, full disk", "replace, edited",
    "replace wal, edited", "fresh", "fresh, full disk",
)  # fmt: skip
EDITS = (  # by hand, of views that were linked before; ids of photographs are 1 to 3, of views from 4
    "DELETE FROM images WHERE name LIKE 'a_001%#close'",
    "DELETE FROM keypoints WHERE image_id = 4",
    "DELETE FROM matches WHERE pair_id > 2147483647 * 4",
    "DELETE FROM two_view_geometries WHERE pair_id > 2147483647 * 6",
    "DELETE FROM frame_data WHERE data_id > 5",
    "UPDATE images SET name = 'mine.jpg' WHERE name = 'a_002.jpg#open'",
)


def random_views(name: str, count: int, rng: np.random.Generator) -> ExposureViews:
    """Return views of random points with a geometry that has all of its parts."""
    first = rng.uniform(0, 60, (count, 2))
    geometry = TwoViewGeometry(
        F=rng.normal(size=(3, 3)),
        H=np.eye(3) + 0.01 * rng.normal(size=(3, 3)),
        config=Configuration.UNCALIBRATED,
        reason="drawn at random",
        inlier_mask=rng.random(count) < 0.8,
        swapped=np.zeros(count, bool),
    )
    return ExposureViews(
        name=name,
        size=(96, 64),
        points_open=first,
        points_close=first + rng.normal(0, 3, (count, 2)),
        sigma_px=np.ones(count),
        geometry=geometry,
        camera=None,
        time=TimeDirection(known=True, confidence=0.9),
    )


def link_jobs(
    path: Path, rng: np.random.Generator, *, again: bool = False
) -> list[tuple[LinkStep, ExposureViews]]:
    """Return plans with random views for all images of a project."""
    photographs = [Path(f"a_{index:03d}.jpg") for index in range(IMAGES)]
    jobs = []
    for plan in plan_links(path, photographs, replace=again):
        if not isinstance(plan, LinkStep):
            raise plan
        views = random_views(plan.image.name, FEATURES, rng)
        usable = views.geometry.inlier_mask | (rng.random(FEATURES) < 0.5)
        jobs.append((plan, replace(views, usable=usable)))
    return jobs


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """A kind of write: the file before it (None: none), the writes that run at once, and what disturbs them.

    Of several writes the first is killed; ``full_disk`` kills none, but lets no file grow beyond a size.
    ``states`` are what may be left, what was there before first; a write takes ``duration_s``, a file becomes
    as large as ``largest`` bytes.
    """

    before: Path | None
    writes: tuple[Write, ...]
    reader: bool = False
    full_disk: bool = False
    states: tuple[object, ...] = ()
    duration_s: float = 0.0
    largest: int = 0


def make_trial(folder: Path, kind: str) -> Trial:
    """Return one kind of write, prepared."""
    rng = np.random.default_rng(0)
    full_disk = "full disk" in kind
    if "fresh" in kind:
        views = [random_views(f"a_{index}.jpg", FEATURES, rng) for index in range(IMAGES)]
        fresh = Trial(before=None, writes=(lambda path: write_database(path, views),), full_disk=full_disk)
        return undisturbed(folder, fresh)
    before = folder / f"{kind.replace(' ', '-')}.db"
    make_project(before, ProjectOptions(images=IMAGES, features=FEATURES, wal="wal" in kind))
    again = "replace" in kind
    if again:
        write_links(before, link_jobs(before, rng), backup=False)
    if "edited" in kind:
        with closing(sqlite3.connect(before)) as database:
            database.executescript(";".join(EDITS))
    jobs = link_jobs(before, rng, again=again)
    shares = [jobs[:1], jobs[1:]] if "two writers" in kind else [jobs]
    writes = tuple(partial(write_links, links=share, backup="backup" in kind) for share in shares)
    trial = Trial(before=before, writes=writes, reader="reader" in kind, full_disk=full_disk)
    return undisturbed(folder, trial)


def undisturbed(folder: Path, trial: Trial) -> Trial:
    """Return a trial with what whole writes leave, in any order, and one alone."""
    path, durations, largest = folder / "whole.db", [], 0
    states = [contents(trial.before) if trial.before else None]
    for count in range(1, len(trial.writes) + 1):
        for order in permutations(trial.writes, count):
            start = time.perf_counter()
            if trial.before is not None:
                shutil.copy(trial.before, path)
            for write in order:
                write(path)
            durations.append(time.perf_counter() - start)
            if trial.before and user_rows(trial.before) != user_rows(path):
                raise RuntimeError(f"{trial.before}: a whole write changes rows of the user")
            states.append(contents(path))
            largest = max(largest, path.stat().st_size)
            _clear(folder, path)
    return replace(trial, states=tuple(states), duration_s=max(durations), largest=largest)


def contents(path: Path) -> object:
    """Return all rows of a database but for SQLite's own bookkeeping of ids; None where there is none."""
    if not path.exists():
        return None
    with closing(sqlite3.connect(path)) as database:
        tables = [row[0] for row in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        tables = sorted(table for table in tables if table != "sqlite_sequence")
        return {table: sorted(database.execute(f"SELECT * FROM {table}"), key=repr) for table in tables}


def run_children(trial: Trial, path: Path, delay_s: float | None, largest: int | None = None) -> float:
    """Run the writes in children and kill the first after a delay; return how long it lived."""
    if trial.before is not None:
        shutil.copy(trial.before, path)
    reader = _child(partial(_read_on, path)) if trial.reader else None
    start = time.perf_counter()
    children = [_child(partial(write, path), largest) for write in trial.writes]
    if delay_s is not None and largest is None:
        time.sleep(delay_s)
        os.kill(children[0], signal.SIGKILL)
    os.waitpid(children[0], 0)
    lived_s = time.perf_counter() - start
    for child in children[1:]:
        os.waitpid(child, 0)
    if reader is not None:
        os.kill(reader, signal.SIGKILL)
        os.waitpid(reader, 0)
    return lived_s


def _child(work: Callable[[], object], largest: int | None = None) -> int:
    """Start a process that does some work and ends without a word, and return its id."""
    child = os.fork()
    if child == 0:
        try:
            if largest is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))
            work()
        except Exception:  # a refusal is an outcome; what it leaves is looked at
            pass
        finally:
            os._exit(0)
    return child


def _read_on(path: Path) -> None:
    """Read the database again and again, as a program does that shows it."""
    while True:
        with closing(sqlite3.connect(path)) as database, suppress(sqlite3.OperationalError):
            database.execute("SELECT count(*), sum(length(data)) FROM keypoints").fetchone()


def disturbed(folder: Path, trial: Trial, share: float) -> str:
    """Disturb one write and return what is left: "before", "after", or what is wrong."""
    path, start = folder / "killed.db", trial.before.stat().st_size if trial.before else 0
    full = round(start + share * (trial.largest - start)) if trial.full_disk else None
    run_children(trial, path, share * trial.duration_s, full)
    hot = any(path.with_name(path.name + ending).exists() for ending in ("-journal", "-wal"))
    try:
        left = contents(path)
        if left not in trial.states:  # all of which hold the user's rows
            return "between"
        if "edited" not in str(trial.before) and path.exists() and (problems := check_database(path)):
            return f"broken: {problems[0]}"
        if why := _not_linkable(trial, path):
            return why
    except sqlite3.Error as error:
        return f"unreadable: {error}"
    finally:
        _clear(folder, path)
    state = "before" if left == trial.states[0] else "after"
    return f"{state}, journal left" if hot else state


def _not_linkable(trial: Trial, path: Path) -> str:
    """Link all photographs once more; return why that fails, or what it breaks, if so."""
    if trial.before is None:
        return ""
    try:
        write_links(path, link_jobs(path, np.random.default_rng(1), again=True), backup=False)
    except DatabaseError as error:
        return f"cannot be linked: {error}"
    if user_rows(path) != user_rows(trial.before):
        return "linking again changes rows of the user"
    return "; ".join(line for line in check_database(path) if "#" in line)  # what is said of our views


def _clear(folder: Path, path: Path) -> None:
    for file in folder.iterdir():
        if file.name.lstrip(".").startswith(path.name):
            file.unlink()


def kill_many(count: int, seed: int = 0, kinds: tuple[str, ...] = KINDS) -> dict[str, Counter[str]]:
    """Kill ``count`` writes, of all kinds alternately, and return how often what was left, by kind."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        trials = {kind: make_trial(folder, kind) for kind in kinds}
        found: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
        for number in range(count):
            kind = kinds[number % len(kinds)]
            one = trials[kind]
            found[kind][disturbed(folder, one, float(rng.uniform(0, 1.1)))] += 1
            if number % 50 == 49:
                print(f"{number + 1}: {dict(sum(found.values(), Counter()))}", flush=True)
            if number % 60 >= 60 - len(kinds):  # as the machine is now: moments stay spread over the write
                fresh_s = run_children(one, folder / "whole.db", None)
                trials[kind] = replace(one, duration_s=0.5 * (one.duration_s + fresh_s))
                _clear(folder, folder / "whole.db")
    return found


def main() -> None:
    """Print what was left, by kind."""
    parser = parser_of(__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    found = kill_many(options.count, options.seed)
    total: Counter[str] = Counter()
    for kind, counter in found.items():
        print(f"{kind}: {dict(sorted(counter.items()))}")
        total += counter
    print(f"all: {dict(sorted(total.items()))}")
    bad = {left for left in total if left.split(",")[0] not in ("before", "after")}
    raise SystemExit(f"wrong: {bad}" if bad else 0)


if __name__ == "__main__":
    main()
