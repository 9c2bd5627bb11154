"""`re3 compare`, on results that `re3 eval` wrote and on made-up ones."""

import json
import math

import pytest
from typer.testing import CliRunner

from re3.apps.cli import app


def invoke(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def write(folder, tracker, values, protocol="starts", **more):
    """Results of one tracker: sequence -> (AUC, share of frames lost)."""
    folder.mkdir(exist_ok=True)
    records = [
        {"dataset": "d", "sequence": name, "tracker": tracker, "auc": auc, "lost": lost, **more}
        for name, (auc, lost) in values.items()
    ]
    document = {"protocol": protocol, "sequences": records}
    (folder / "results.json").write_text(json.dumps(document))
    return folder


@pytest.fixture
def two(tmp_path):
    """Results of the trackers `old` and `new` on three clips, two starts of the first."""
    old = {"d/a/1": (0.5, 0.2), "d/a/2": (0.7, 0.0), "d/b/1": (0.4, 0.5), "d/c/1": (0.9, 0.0)}
    new = {"d/a/1": (0.7, 0.2), "d/a/2": (0.7, 0.0), "d/b/1": (0.6, 0.2), "d/c/1": (0.9, 0.0)}
    return write(tmp_path / "old", "old", old), write(tmp_path / "new", "new", new)


def test_differences_are_paired_by_clip(two, tmp_path):
    file = tmp_path / "differences.json"
    result = invoke("compare", *two, "--json", file)
    assert result.exit_code == 0, result.output
    (found,) = json.loads(file.read_text())
    auc, lost = found["figures"]
    # Of the clips: .1 (of two starts .2 and 0), .2, 0.
    assert auc["difference"]["mean"] == pytest.approx(0.1)
    assert auc["difference"]["error"] == pytest.approx(0.1 / math.sqrt(3))
    assert (auc["first"], auc["second"]) == pytest.approx((1.9 / 3, 2.2 / 3))
    assert (auc["better"], auc["worse"], auc["difference"]["count"]) == (2, 0, 3)
    # Fewer frames lost are better.
    assert lost["difference"]["mean"] == pytest.approx(-0.1)
    assert (lost["better"], lost["worse"]) == (1, 0)
    words = " ".join(result.stdout.split())
    assert "new against old: 3 clips" in words
    assert "AUC 0.633 0.733 +0.100 0.058 2 0" in words
    assert "d/b 0.400 +0.200" in words


def test_only_sequences_that_both_have(two):
    old, new = two
    document = json.loads((new / "results.json").read_text())
    document["sequences"][0]["auc"] = None  # could not be read
    (new / "results.json").write_text(json.dumps(document))
    result = invoke("compare", old, new)
    assert result.exit_code == 0, result.output
    words = " ".join(result.stdout.split())
    assert "d/a 0.700 +0.000" in words
    assert "note: 1 sequences were left out that only one of old and new has" in words


def test_trackers_of_one_folder_and_of_one_name(two, tmp_path):
    old, new = two
    records = [json.loads((folder / "results.json").read_text()) for folder in two]
    records[0]["sequences"] += records[1]["sequences"]
    (old / "results.json").write_text(json.dumps(records[0]))
    assert "new against old" in invoke("compare", old).stdout
    assert "old against new" in invoke("compare", old, "-t", "new", "-t", "old").stdout
    both = " ".join(invoke("compare", new, old, "-t", "new").stdout.split())
    assert f"{old}: new against {new}: new".replace(" ", "") in both.replace(" ", "")


def test_variants_of_a_clip_are_not_clips_of_their_own(tmp_path):
    folders = [tmp_path / "one", tmp_path / "two"]
    for folder, gain in zip(folders, (0.0, 0.1), strict=True):
        write(folder, folder.name, {}, protocol="hidden")
        document = json.loads((folder / "results.json").read_text())
        document["sequences"] = [
            {"dataset": dataset, "sequence": "a", "tracker": folder.name, "auc": 0.5 + gain * part}
            for dataset, part in (("d-hidden-5", 1), ("d-hidden-10", 3), ("e-hidden-5", 1))
        ]
        (folder / "results.json").write_text(json.dumps(document))
    result = invoke("compare", *folders)
    words = " ".join(result.stdout.split())
    # d: .1 and .3; e: .1.
    assert "two against one: 2 clips" in words and "+0.150 0.050" in words
    assert "d: a 0.500 +0.200" in words and "e: a 0.500 +0.100" in words


def test_what_cannot_be_compared_is_told(two, tmp_path):
    old, new = two
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "results.json").write_text('{"protocol": "starts"}')
    other = write(tmp_path / "ope", "other", {"a": (0.5, 0.1)}, protocol="ope")
    elsewhere = write(tmp_path / "elsewhere", "elsewhere", {"d/z/1": (0.5, 0.1)})
    for arguments, told in [
        ([old], "expected those of two trackers or more"),
        ([old, tmp_path / "gone"], "gone/results.json does not exist; expected a folder that"),
        ([old, tmp_path / "broken"], "does not hold results of `re3 eval`"),
        ([old, other], "results of different protocols: old by starts, other by ope"),
        ([old, elsewhere], "old and elsewhere have no sequence in common"),
        ([old, new, "-t", "nobody"], "no results of tracker 'nobody'; there are some of old, new"),
    ]:
        result = invoke("compare", *arguments)
        assert result.exit_code == 2, result.output
        assert told in " ".join(result.stderr.split())
        assert "Traceback" not in result.output


def test_results_of_one_pass_and_of_restarts_can_be_compared(tmp_path):
    one = write(tmp_path / "one", "one", {"a": (0.5, 0.1), "b": (0.6, 0.0)}, protocol="ope")
    two = write(tmp_path / "two", "two", {"a": (0.6, 0.1), "b": (0.8, 0.0)}, protocol="ope")
    assert "+0.150 0.050" in " ".join(invoke("compare", one, two).stdout.split())
    for folder, drops in ((one, 3), (two, 1)):
        values = {"a": (0.5, 0.1), "b": (0.6, 0.0)}
        write(folder, folder.name, values, protocol="ablation", drops=drops, accuracy=0.5)
    assert "drops 3.000 1.000 -2.000 0.000 2 0" in " ".join(
        invoke("compare", one, two).stdout.split()
    )
