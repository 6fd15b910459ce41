"""Kill a process with SIGKILL at a random moment of a write, many times, and look at the database afterwards.

    python -m tools.database_safety.kill_writes --count 1000

Every trial copies a project, lets a child write views into it (or a fresh database, or replace views) and
kills it after a random share of the time such a write takes. The database must then be whole and either
exactly as before or exactly as after a whole write; the user's rows are the same in both. Kinds alternate:
link and replace into write-ahead-logged and rollback-journal projects, with and without backup, and fresh.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import sqlite3
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from blur2view.colmap.database import write_database
from blur2view.colmap.link import LinkJob, LinkStep, plan_links, write_links
from blur2view.exposure.linked_views import KeypointViews
from blur2view.exposure.views import ExposureViews, TimeDirection
from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry
from tools.database_safety.colmap_check import check_database
from tools.database_safety.colmap_projects import ProjectOptions, make_project, user_rows

IMAGES, FEATURES = 3, 500
KINDS = ("link", "link wal", "link wal backup", "replace", "replace wal", "fresh")


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


def link_jobs(path: Path, rng: np.random.Generator, *, again: bool = False) -> list[LinkJob]:
    """Return jobs with random views for all images of a project."""
    photographs = [Path(f"a_{index:03d}.jpg") for index in range(IMAGES)]
    jobs = []
    for plan in plan_links(path, photographs, replace=again):
        if not isinstance(plan, LinkStep):
            raise plan
        views = random_views(plan.image.name, FEATURES, rng)
        usable = views.geometry.inlier_mask | (rng.random(FEATURES) < 0.5)
        jobs.append(LinkJob(plan=plan, linked=KeypointViews(views=views, usable=usable)))
    return jobs


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A kind of write: the file before it (None: none), and the write."""

    before: Path | None
    write: Callable[[Path], object]


def make_trial(folder: Path, kind: str) -> Trial:
    """Return one kind of write, prepared."""
    rng = np.random.default_rng(0)
    if kind == "fresh":
        views = [random_views(f"a_{index}.jpg", FEATURES, rng) for index in range(IMAGES)]
        return Trial(before=None, write=lambda path: write_database(path, views))
    before = folder / f"{kind.replace(' ', '-')}.db"
    make_project(before, ProjectOptions(images=IMAGES, features=FEATURES, wal="wal" in kind))
    again = "replace" in kind
    if again:
        write_links(before, link_jobs(before, rng), backup=False)
    jobs = link_jobs(before, rng, again=again)
    return Trial(before=before, write=lambda path: write_links(path, jobs, backup="backup" in kind))


def contents(path: Path) -> object:
    """Return all rows of a database but for SQLite's own bookkeeping of ids; None where there is none."""
    if not path.exists():
        return None
    with closing(sqlite3.connect(path)) as database:
        tables = [row[0] for row in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        tables = sorted(table for table in tables if table != "sqlite_sequence")
        return {table: sorted(database.execute(f"SELECT * FROM {table}"), key=repr) for table in tables}


def run_child(trial: Trial, path: Path, delay_s: float | None) -> float:
    """Write in a child and kill it after a delay; return how long it lived."""
    if trial.before is not None:
        shutil.copy(trial.before, path)
    start = time.perf_counter()
    child = os.fork()
    if child == 0:
        try:
            trial.write(path)
        finally:
            os._exit(0)
    if delay_s is not None:
        time.sleep(delay_s)
        os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return time.perf_counter() - start


@dataclass(frozen=True, kw_only=True, eq=False)
class Expected:
    """What a kind of write starts from and ends with, and how long it takes."""

    trial: Trial
    before: object
    after: object
    duration_s: float


def expect(folder: Path, kind: str) -> Expected:
    """Return what one whole write of a kind leaves."""
    trial, path = make_trial(folder, kind), folder / "whole.db"
    before = contents(trial.before) if trial.before else None
    duration_s = run_child(trial, path, None)
    if trial.before and user_rows(trial.before) != user_rows(path):
        raise RuntimeError(f"{kind}: a whole write changes rows of the user")
    expected = Expected(trial=trial, before=before, after=contents(path), duration_s=duration_s)
    _clear(folder, path)
    return expected


def killed(folder: Path, expected: Expected, delay_s: float) -> str:
    """Kill one write and return what is left: "before", "after", or what is wrong."""
    path = folder / "killed.db"
    run_child(expected.trial, path, delay_s)
    hot = any(path.with_name(path.name + ending).exists() for ending in ("-journal", "-wal"))
    try:
        left = contents(path)
        if left not in (expected.before, expected.after):  # what these hold of the user is equal: `expect`
            return "between"
        if path.exists() and (problems := check_database(path)):
            return f"broken: {problems[0]}"
    except sqlite3.Error as error:
        return f"unreadable: {error}"
    finally:
        _clear(folder, path)
    state = "before" if left == expected.before else "after"
    return f"{state}, journal left" if hot else state


def _clear(folder: Path, path: Path) -> None:
    """Remove a database and all that lies beside it."""
    for file in folder.iterdir():
        if file.name.lstrip(".").startswith(path.name):
            file.unlink()


def kill_many(count: int, seed: int = 0, kinds: tuple[str, ...] = KINDS) -> dict[str, Counter[str]]:
    """Kill ``count`` writes, of all kinds alternately, and return how often what was left, by kind."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        expected = {kind: expect(folder, kind) for kind in kinds}
        found: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
        for number in range(count):
            kind = kinds[number % len(kinds)]
            one = expected[kind]
            delay_s = float(rng.uniform(0, 1.1 * one.duration_s))
            found[kind][killed(folder, one, delay_s)] += 1
            if number % 50 == 49:
                print(f"{number + 1}: {dict(sum(found.values(), Counter()))}", flush=True)
            # as the machine is now, so that moments stay spread over the write
            if number % 60 >= 60 - len(kinds):
                fresh_s = run_child(one.trial, folder / "whole.db", None)
                expected[kind] = replace(one, duration_s=0.5 * (one.duration_s + fresh_s))
                _clear(folder, folder / "whole.db")
    return found


def main() -> None:
    """Print what was left, by kind."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
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
