import pytest

from re3.csv_text import csv_text
from re3.result import Result, Status
from re3.video import open_results


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("dog", "dog"),
        ("", ""),
        ("a=b", "a=b"),  # within a name it is no formula
        ("3 dogs", "3 dogs"),
        ("=cmd|'/c calc'!A1", "'=cmd|'/c calc'!A1"),
        ("+1", "'+1"),
        ("-1+1", "'-1+1"),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("\t=1", "'\t=1"),
        ("\r=1", "'\r=1"),
    ],
)
def test_a_name_is_no_formula(name, text):
    assert csv_text(name) == text


@pytest.mark.parametrize("kind", ["file", "stdout"])
def test_names_of_objects_in_results(tmp_path, capsys, kind):
    path = tmp_path / "boxes.csv"
    with open_results(path if kind == "file" else "-") as results:
        results.write(0, 0.0, [Result((-1, 2, 3, 4), 0.5, Status.TRACKED, 1, 1, "=cmd|'/c calc'")])
    text = path.read_text() if kind == "file" else capsys.readouterr().out
    # Boxes stay numbers, negative ones too.
    assert text.splitlines()[1] == "0,0.0,'=cmd|'/c calc',-1,2,3,4,0.5,tracked"
    other = tmp_path / "boxes.jsonl"
    with open_results(other) as results:
        results.write(0, 0.0, [Result((1, 2, 3, 4), 0.5, Status.TRACKED, 1, 1, "=1")])
    assert '"object": "=1"' in other.read_text()
