"""The record of a photograph: what is written is read back, and tables are its flat part."""

import csv
import io
import json
from pathlib import Path

import pytest

import blur2view
from blur2view.records.record import Record, explanations, table_text


@pytest.fixture
def record(moving: Path, tiny_model: Path) -> Record:
    estimate = blur2view.estimate(moving, network=tiny_model)
    return Record.from_estimate(estimate, name="a.jpg", exposure_s=0.04, input_sha256="ab")


def test_json_holds_the_record_and_what_is_derived_is_computed_anew(record: Record) -> None:
    assert Record.from_json(record.to_json()) == record
    stored = json.loads(record.to_json())
    assert list(stored) == list(explanations()) and stored["verdict"] == record.verdict
    edited = json.dumps(stored | {"verdict": "Sharp", "unknown": 1})
    assert Record.from_json(edited).verdict == record.verdict
    probabilities = [one["probability"] for one in record.models or ()]
    assert probabilities == sorted(probabilities, reverse=True) and record.model_probability is not None
    for text in ("[]", "{}", "not JSON", b"\xff", "[" * 99_999):
        with pytest.raises(ValueError, match="is not a JSON document of a photograph"):
            Record.from_json(text)


def test_a_failed_photograph_has_a_name_and_an_error_alone() -> None:
    one = Record(name="b.jpg", error="b.jpg: is no picture")
    assert json.loads(one.to_json()) == {"name": "b.jpg", "error": one.error}
    assert Record.from_json(one.to_json()) == one and one.verdict == one.error
    (row,) = csv.DictReader(io.StringIO(table_text([one]).decode()))
    assert {name for name, value in row.items() if value} == {"name", "error", "verdict"}


def test_a_table_is_the_flat_part_of_the_records(record: Record) -> None:
    (row,) = csv.DictReader(io.StringIO(table_text([record]).decode()))
    assert list(row)[:5] == ["name", "error", "use", "verdict", "blur"] and row["name"] == "a.jpg"
    assert set(row) == set(explanations(flat=True)) <= set(explanations())
    assert row["config"] == record.config and row["verdict"] == record.verdict
    assert record.smear_px is not None and float(row["smear_px"]) == pytest.approx(record.smear_px, rel=1e-5)
    assert "F" not in row and "models" not in row


def test_width_is_that_of_smear_and_lens_as_a_smear_spreads() -> None:
    one = Record(name="a.jpg", width=600, smear_px=3.0, defocus_px=4 / 3**0.5)
    assert one.blur_px == pytest.approx(5) and one.smear_percent == pytest.approx(0.5)
    assert Record(name="a.jpg").blur_px is None
