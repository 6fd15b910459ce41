"""The paper's tables: judged as by hand, resumed, chosen without truth, reported."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view.geometry.sampson import serrmin
from blur2view.networks.smear_network import SmearNetwork
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view
from blur2view.two_view.options import EstimatorOptions
from tools.datasets import testset
from tools.datasets.testset import TestScene, read_test_set
from tools.estimators.paper import PaperOptions, paper_of_matches
from tools.pages import write_json
from tools.paper import experiments as paper
from tools.paper import paper_report, paper_tables
from tools.paper.paper_tables import AUTOMATIC, BETAS, Found, all_true_ends, cost, rows_of, with_automatic
from tools.paper.paper_variants import SIX, VARIANTS

SIZE = (160, 128)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> TestScene:
    """Return a small scene of a test split whose camera translates."""
    out = tmp_path_factory.mktemp("split")
    testset.write_scene(4, out, testset.test_options(None, SIZE))
    return next(read_test_set(out))


def found(scene: TestScene, estimator: str, beta: float, F: Any, score: float) -> Found:
    matrix = None if F is None else np.asarray(F).tolist()
    return Found(
        model_id="m", scene=scene.name, estimator=estimator, beta=beta, F=matrix, cost=score, seconds=beta
    )


def test_automatic_choice_is_the_cheapest_of_ours(scene: TestScene) -> None:
    scores = dict(zip(BETAS, (4.0, 2.0, 1.0, 3.0), strict=True))
    records = [found(scene, name, b, scene.F, scores[b]) for name in ("ours", "paper") for b in BETAS]
    groups = with_automatic(records)
    assert groups["ours", AUTOMATIC][scene.name].beta == 0.45 and ("paper", AUTOMATIC) not in groups
    rows = {(row.estimator, row.beta): row for row in rows_of(records, [scene])}
    assert len(rows) == 4 + 5 + 1 and rows["ours", AUTOMATIC].seconds == pytest.approx(sum(BETAS))


def test_rows_are_judged_as_by_hand(scene: TestScene) -> None:
    wrong = np.array([[0, -1, 100.0], [1, 0, -20], [-100, 20, 0]])
    matches = SmearMatches.from_points(*np.moveaxis(all_true_ends(scene), 1, 0))
    assert cost(scene.F, matches) < cost(wrong, matches) < cost(None, matches) == 9
    records = [found(scene, "ours", 0.2, None, 9), found(scene, "ours", 0.35, wrong, 1)]
    rows = {row.beta: row for row in rows_of(records, [scene])}
    ends = all_true_ends(scene)
    assert len(ends) == scene.valid.sum() and scene.F is not None
    none, other, true = rows["20%"], rows["35%"], rows["-"]
    assert none.without_F == 1 and none.inliers == none.inliers_of_true == 0
    assert none.serrmin_px2 == pytest.approx(np.median(((ends[:, 1] - ends[:, 0]) ** 2).sum(1)))
    assert other.inliers == pytest.approx((serrmin(wrong, ends) < 3).mean())
    assert other.serrmin_px2 == pytest.approx(np.median(serrmin(wrong, ends)))
    assert true.inliers == pytest.approx((serrmin(scene.F, ends) < 3).mean()) and true.inliers_of_true == 1
    assert other.inliers_of_true == pytest.approx(other.inliers / true.inliers)


def test_table_2_is_resumed(
    scene: TestScene, tiny_model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    quick = {
        "paper": lambda matches: paper_of_matches(matches, PaperOptions(max_iterations=2)),
        "ours": lambda matches: estimate_two_view(matches, EstimatorOptions(max_iterations=2)).F,
    }
    monkeypatch.setattr(paper_tables, "ESTIMATORS", quick)
    work, network = tmp_path / "work" / "table2.jsonl", SmearNetwork(tiny_model)
    whole = paper_tables.complete([scene], network, work)
    lines = work.read_text().splitlines()
    assert len(lines) == len(whole) == 8
    work.write_text("\n".join(lines[:5]) + "\n" + lines[5][:40])  # killed while writing the sixth
    again = paper_tables.complete([scene], network, work)
    assert [replace(one, seconds=0) for one in again] == [replace(one, seconds=0) for one in whole]


def variant_document(name: str, epe_s: float) -> dict[str, Any]:
    return dict.fromkeys(paper_report.MEASURES, epe_s) | {"steps": 10, "name": name}


def test_report_says_what_is_there_what_is_missing_and_what_is_best(tmp_path: Path, scene: TestScene) -> None:
    with pytest.raises(SystemExit, match="paper_table2.json is missing"):
        paper_report.report(tmp_path)
    runs = tmp_path / "runs" / "variants"
    runs.mkdir(parents=True)
    for k, name in enumerate(VARIANTS):
        for seed in range(2):
            document = variant_document(name, 1 + seed + 4 * (name != SIX[1].name) + k)
            (runs / f"{name}_{seed}.json").write_text(json.dumps(document))
    plan = paper.Plan(photos=None, work=tmp_path / "runs", shards=tmp_path, scenes=tmp_path, results=tmp_path)
    records = [found(scene, "ours", beta, scene.F, beta) for beta in BETAS]
    rows = [asdict(row) for row in rows_of(records, [scene])]
    write_json(tmp_path / "paper_table2.json", {"model_id": "m", "rows": rows})
    errors = {"epe_s_top50": 1.0, "epe_s_top50_over_length": 0.25}
    write_json(tmp_path / "evaluation.json", {"smears": errors})
    paper.write_report(plan)
    text = (tmp_path / "paper.md").read_text()
    assert "| 0.829 | - | 0.422 | 0.605 | 0.70 |" in text and "split, ours | 1.000 | 0.250 |" in text
    assert "by EPE-S top 50 %: local, with map (in the paper: double, with map), 2.500; next" in text
    assert "| stem_local_map_0.01 | local, with map | 0.01 | 10 | 2 | 2.500 ± 0.500 |" in text
    assert "automatically is at least as good as the best fixed share by inliers" in text
    assert "alpha" in text and "0.05 | 10 | 2" in text
