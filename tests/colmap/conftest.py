"""A project of a user, as COLMAP writes it."""

from pathlib import Path

import pytest

from tests.support.colmap_projects import ProjectOptions, make_project


@pytest.fixture
def path(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """Return the database of a project, with a write-ahead log unless the test asks for another."""
    make_project(tmp_path / "project.db", getattr(request, "param", None) or ProjectOptions())
    return tmp_path / "project.db"
