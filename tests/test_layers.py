"""Who may import whom: layers of the package, read from the source and checked in a fresh interpreter."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "blur2view"

# From the bottom up: a module imports only from layers below its own, so there are no cycles.
LAYERS = [
    {"errors", "ransac", "drawing"},
    {"image", "smear", "tiles", "network_file", "epipolar", "exif", "colmap"},
    {"pyramid"},
    {"predict", "matches", "metrics", "seven_smears", "hypotheses", "scoring", "sign_graph", "depth"}
    | {"cameras"},
    {"manifold", "components", "paper", "sign_free", "translation_grid"},
    {"pose", "exposure_motion"},
    {"geometry"},
    {"refine", "end_order"},
    {"homography"},
    {"homography_search", "parallax"},
    {"estimators"},
    {"families"},
    {"search", "motions", "plane_parallax"},
    {"trust", "verdict"},
    {"planarity"},
    {"degeneracy", "calibrated"},
    {"two_view"},
    {"pipeline", "panel", "intrinsics"},
    {"reduced"},
    {"viz", "exposure_views", "half_exposure", "colmap_schema", "motion_score", "object_motion"}
    | {"report_pack"},
    {"mapping", "translation_sign", "neighbours", "motion_regions", "motion_features"},
    {"motion_network"},
    {"time_direction"},
    {"segmentation"},
    {"results", "colmap_rows", "colmap_check", "colmap_project", "keypoint_views"}
    | {"mask_overlay", "view_placement"},
    {"colmap_database", "matches_text", "estimate_file", "summary"},
    {"mask_results"},
    {"colmap_link", "hloc_files", "report_photograph"},
    {"report"},
    {"__init__"},
    {"cli_options"},
    {"cli_batch"},
    {"cli_colmap", "cli_segment", "cli_report"},
    {"cli"},
    {"__main__"},
]
RANK = {module: rank for rank, layer in enumerate(LAYERS) for module in layer}
MODULES = sorted(path.stem for path in PACKAGE.glob("*.py"))

# What the geometry may use besides the standard library and this package.
NUMERIC = {"numpy", "scipy", "cv2"}
BEFORE_MATCHES = {"image", "network_file", "pyramid", "predict", "exif", "colmap"}
GEOMETRY = set().union(*LAYERS[: LAYERS.index({"two_view"}) + 1]) - BEFORE_MATCHES
DISTRIBUTION = {"cv2": "opencv-contrib-python-headless", "PIL": "pillow", "skimage": "scikit-image"}
EXTRAS = {"h5py": "hloc"}  # what one door alone needs, and the extra that brings it
PACKAGE_MAY_USE = NUMERIC | {"onnxruntime", "pycolmap", "PIL", "skimage", "tqdm"} | set(EXTRAS)


def imported(path: Path) -> Iterator[str]:
    """Yield the dotted name of every import in a file, also of those inside functions."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert node.module is not None
            yield node.module
            # "from blur2view import smear" imports a module too
            yield from (f"{node.module}.{alias.name}" for alias in node.names if node.module == "blur2view")


def own_imports(module: str) -> set[str]:
    """Return the modules of the package that a module imports."""
    names = {name for name in imported(PACKAGE / f"{module}.py") if name.split(".")[0] == "blur2view"}
    return {(name.split(".") + ["__init__"])[1] for name in names} & (set(MODULES) | {"__init__"})


def third_party(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imported(path)} - set(sys.stdlib_module_names) - {"blur2view"}


@pytest.mark.parametrize("module", MODULES)
def test_module_imports_only_from_lower_layers(module: str) -> None:
    assert module in RANK, f"give {module} its place in LAYERS"
    above = {name for name in own_imports(module) if RANK[name] >= RANK[module]}
    assert not above, f"{module} imports {above}, which are not below it"


def test_robust_loop_knows_nothing_of_ours() -> None:
    assert own_imports("ransac") == set()


@pytest.mark.parametrize("module", sorted(GEOMETRY & set(MODULES)))
def test_geometry_needs_arrays_only(module: str) -> None:
    assert third_party(PACKAGE / f"{module}.py") <= NUMERIC


@pytest.mark.parametrize("module", MODULES)
def test_package_uses_neither_torch_nor_tools(module: str) -> None:
    assert third_party(PACKAGE / f"{module}.py") <= PACKAGE_MAY_USE


def test_dependencies_are_what_the_package_imports() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    declared = {re.split(r"[<>=!~]", requirement)[0] for requirement in project["dependencies"]}
    used = set().union(*(third_party(PACKAGE / f"{module}.py") for module in MODULES))
    assert declared == {DISTRIBUTION.get(name, name) for name in used - set(EXTRAS)}
    for name in used & set(EXTRAS):
        extra = project["optional-dependencies"][EXTRAS[name]]
        assert [re.split(r"[<>=!~]", requirement)[0] for requirement in extra] == [name]


@pytest.mark.parametrize("path", sorted((ROOT / "tools").rglob("*.py")), ids=lambda path: path.name)
def test_tools_do_not_use_tests(path: Path) -> None:
    assert not {"tests", "conftest", "scenes"} & {name.split(".")[0] for name in imported(path)}


def test_import_of_the_package_is_light() -> None:
    heavy = ["h5py", "matplotlib", "onnx", "onnxruntime", "pycolmap", "scipy.ndimage", "skimage", "torch"]
    heavy += ["tqdm"]
    program = f"import sys, blur2view; print([name for name in {heavy} if name in sys.modules])"
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == "[]"
