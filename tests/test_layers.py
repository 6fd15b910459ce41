"""Who may import whom: the rooms of the package, read from the source and checked in a fresh interpreter."""

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import blur2view

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "blur2view"

# A row uses only rows above it; within a row nothing is used across rooms.
ROWS = [
    "__init__ arrays errors",
    "files processes",
    "output",
    "camera smears",
    "geometry images",
    "networks",
    "two_view",
    "movers records",
    "pipeline",
    "exposure",
    "results",
    "colmap",
    "reconstruction",
    "cli",
    "__main__",
]
RANK = {room: rank for rank, row in enumerate(ROWS) for room in row.split()}
MAX_FILES, MAX_MODULES, MAX_LINES = 12, 18, 410
CODE = [*PACKAGE.rglob("*.py"), *(ROOT / "tools").rglob("*.py")]
SOURCES = sorted(path.relative_to(ROOT) for path in CODE)

NUMERIC = {"numpy", "scipy", "cv2"}
ARRAYS_ONLY = {"arrays", "smears", "two_view"}  # geometry states itself as pycolmap's
DISTRIBUTION = {"cv2": "opencv-contrib-python-headless", "PIL": "pillow", "skimage": "scikit-image"}
DISTRIBUTION |= {"pillow_heif": "pillow-heif"}
EXTRAS = {
    "argcomplete": "completion",
    "pillow_heif": "heic",
    "rawpy": "raw",
    "distributed": "dask",
}  # imported by one function each
PACKAGE_MAY_USE = (
    NUMERIC | {"onnxruntime", "pycolmap", "PIL", "skimage", "threadpoolctl", "tqdm"} | set(EXTRAS)
)
MODULE = {".".join(path.with_suffix("").parts).removesuffix(".__init__"): path for path in SOURCES}


def room_of(path: Path) -> str:
    """Return the room of a source of the package."""
    return path.parts[1].removesuffix(".py")


@cache
def nodes(path: Path) -> list[ast.AST]:
    """Return what a file is made of."""
    return list(ast.walk(ast.parse((ROOT / path).read_text())))


@cache
def imported(path: Path, *, for_types: bool = True) -> frozenset[str]:
    """Return the dotted name of every import in a file, also of those inside functions."""
    found, every = set[str](), nodes(path)
    checks = [one for one in every if isinstance(one, ast.If) and ast.unparse(one.test) == "TYPE_CHECKING"]
    left_out = {node for one in checks for node in one.body if not for_types}
    for node in every:
        if node in left_out:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module, f"{path}: relative import"
            # "from blur2view.smears import field" imports a module too
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def own_imports(path: Path, *, for_types: bool = True) -> set[str]:
    """Return the modules of the repository that a file imports, also ``for_types`` alone."""
    own = [
        name for name in imported(path, for_types=for_types) if name.split(".")[0] in {"blur2view", "tools"}
    ]
    found = {name if name in MODULE else name.rpartition(".")[0] for name in own}
    assert found <= set(MODULE), f"{path} imports {found - set(MODULE)}"
    return {name for name in found if MODULE[name] != path}


def third_party(path: Path) -> set[str]:
    """Return the top-level names of other projects that a file imports."""
    return {name.split(".")[0] for name in imported(path)} - set(sys.stdlib_module_names) - {"blur2view"}


PACKAGE_SOURCES = [path for path in SOURCES if path.parts[0] == "blur2view"]


def test_rooms_use_only_rows_above_them() -> None:
    for path in PACKAGE_SOURCES:
        room = room_of(path)
        used = {room_of(MODULE[name]) for name in own_imports(path)} - {room}
        assert not {other for other in used if RANK[other] >= RANK[room]}, path


def test_no_module_imports_itself_by_way_of_others() -> None:
    used = {name: own_imports(path, for_types=False) for name, path in MODULE.items()}
    TopologicalSorter(used).prepare()


def test_rooms_are_small() -> None:
    for folder in {path.parent for path in SOURCES}:
        modules = [path for path in (ROOT / folder).glob("*.py") if path.name != "__init__.py"]
        assert len(modules) <= MAX_MODULES, folder
        for path in modules:
            assert len(path.read_text().splitlines()) <= MAX_LINES, path
    assert sum(path.is_file() for path in PACKAGE.iterdir()) <= MAX_FILES


@pytest.mark.parametrize("loop", ["ransac", "least_squares"])
def test_loops_know_no_geometry(loop: str) -> None:
    assert own_imports(MODULE[f"blur2view.two_view.{loop}"]) <= {"blur2view.arrays"}


def test_package_uses_neither_torch_nor_tools() -> None:
    for path in PACKAGE_SOURCES:
        assert third_party(path) <= (NUMERIC if room_of(path) in ARRAYS_ONLY else PACKAGE_MAY_USE), path


def test_dependencies_are_what_the_package_imports() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    declared = {re.split(r"[<>=!~]", requirement)[0] for requirement in project["dependencies"]}
    used = set().union(*(third_party(path) for path in PACKAGE_SOURCES))
    assert declared == {DISTRIBUTION.get(name, name) for name in used - set(EXTRAS)}
    for name, extra in EXTRAS.items():
        (requirement,) = project["optional-dependencies"][extra]
        assert re.split(r"[<>=!~]", requirement)[0] == DISTRIBUTION.get(name, name)


def test_tools_do_not_use_tests() -> None:
    for path in SOURCES:
        assert not {"tests", "conftest"} & {name.split(".")[0] for name in imported(path)}, path


def test_version_stands_in_one_place() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert "version" in settings["project"]["dynamic"] and "version" not in settings["project"]
    stated = (ROOT / settings["tool"]["hatch"]["version"]["path"]).read_text()
    assert f'__version__ = "{blur2view.__version__}"' in stated


HEAVY = ["matplotlib", "onnx", "onnxruntime", "pycolmap", "scipy.ndimage", "skimage", "torch"]


@pytest.mark.parametrize(
    ("module", "heavy"),
    [("blur2view", [*HEAVY, "numpy", "cv2"]), ("blur2view.cli.estimate", ["scipy", "skimage", "pycolmap"])],
)
def test_import_of_the_package_is_light_and_an_estimate_starts_without_scipy(
    module: str, heavy: list[str]
) -> None:
    program = f"import sys, {module}; print([name for name in {heavy} if name in sys.modules])"
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == "[]"


def test_an_estimate_of_one_photograph_starts_without_what_only_many_need() -> None:
    many = ["multiprocessing", "concurrent.futures.process", "distributed", "tqdm", "urllib.request", "ssl"]
    program = (
        "import sys; from blur2view.cli.commands import main; main(['estimate', 'models/sample.jpg', '-q'])\n"
        f"print([name for name in {[*many, 'pycolmap', 'scipy', 'skimage', 'html']} if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert done.stdout.strip() == "[]"


def test_public_names_are_where_the_package_says() -> None:
    assert all(getattr(blur2view, name) is not None for name in blur2view.__all__)
    assert len(blur2view.__all__) > 40
