"""Our figures on boxes that others published, against figures computed independently."""

import json

import numpy as np
import pytest

from re3.data.plain import read_boxes
from re3.evaluation.metrics import Scores, score

TOLERANCE = 0.001


def test_published_otb_results(shared_data):
    published = shared_data / "published"
    expected = json.loads((published / "expected.json").read_text(encoding="utf-8"))
    assert len(expected) >= 20
    for tracker, figures in expected.items():
        scores = {
            name: score(
                read_boxes(published / "otb" / tracker / f"{name}.txt"),
                read_boxes(shared_data / "test" / "otb" / f"{name}.txt"),
            )
            for name in figures["per_sequence"]
        }
        assert len(scores) == figures["sequences"]
        for name, (auc, precision) in figures["per_sequence"].items():
            ours = (scores[name].auc, scores[name].precision)
            np.testing.assert_allclose(
                ours, (auc, precision), atol=TOLERANCE, err_msg=f"{tracker}, {name}"
            )
        mean = Scores.mean(list(scores.values()))
        assert mean.auc == pytest.approx(figures["auc"], abs=TOLERANCE), tracker
        assert mean.precision == pytest.approx(figures["precision20"], abs=TOLERANCE), tracker
