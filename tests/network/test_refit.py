"""Weights of one size of crop as a start for another."""

from dataclasses import replace

import pytest
import torch

from re3.model_spec import CropSpec
from re3.network.lite_config import LiteConfig
from re3.network.re3_lite import Re3Lite
from re3.network.refit import refit_weights

SMALL = LiteConfig(
    current=CropSpec(3.0, 96), fully_connected=16, lstm_units=8, fused=8, embedding=8, correlation=4
)
WIDER = replace(SMALL, name="wider", current=CropSpec(4.0, 128))  # the same pixels for the object
FEWER = replace(SMALL, name="fewer", current=CropSpec(4.0, 96))


@pytest.fixture
def source():
    torch.manual_seed(0)
    return Re3Lite(SMALL).eval()


@pytest.mark.parametrize("target", [WIDER, FEWER])
def test_refitted_weights_fit(source, target):
    network = Re3Lite(target)
    network.load_state_dict(refit_weights(source.state_dict(), SMALL, target))


def test_the_same_size_keeps_its_weights(source):
    same = refit_weights(source.state_dict(), SMALL, replace(SMALL, name="same"))
    for name, values in source.state_dict().items():
        torch.testing.assert_close(same[name], values, rtol=1e-4, atol=1e-5)


def test_what_was_not_in_sight_gets_no_weight(source):
    fitted = refit_weights(source.state_dict(), SMALL, WIDER)["head.fully_connected.0.weight"]
    seen = fitted[:, : 8 * 8 * 4].reshape(16, 4, 8, 8)
    assert (seen[:, :, 0] == 0).all()
    inner = source.state_dict()["head.fully_connected.0.weight"][:, : 6 * 6 * 4]
    torch.testing.assert_close(
        seen[:, :, 1:7, 1:7], inner.reshape(16, 4, 6, 6), rtol=1e-4, atol=1e-5
    )


def test_networks_that_differ_in_more_are_refused(source):
    with pytest.raises(ValueError, match="differ in their crops only"):
        refit_weights(source.state_dict(), SMALL, replace(WIDER, fused=16))
