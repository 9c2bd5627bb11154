"""The authors' small network, part by part; whole, it is compared with a file's arrays."""

import pytest
import torch

from re3.model_spec import CropSpec
from re3.network.authors import AuthorsConfig, AuthorsSmallConfig, LSTMCell, SmallTrunk
from re3.network.peephole_lstm import CellState


def test_the_cell_is_torchs():
    torch.manual_seed(0)
    own, theirs = LSTMCell(5, 3), torch.nn.LSTMCell(5, 3)
    values = theirs.state_dict()
    for part, name in (("input", "ih"), ("recurrent", "hh")):
        for kind in ("weight", "bias"):
            values[f"{part}.{kind}"] = values.pop(f"{kind}_{name}")
    own.load_state_dict(values)
    x, output, cell = torch.randn(2, 5), torch.randn(2, 3), torch.randn(2, 3)
    torch.testing.assert_close(tuple(own(x, CellState(output, cell))), theirs(x, (output, cell)))


@pytest.mark.parametrize("size", [227, 99, 64])
def test_the_embedding_has_the_length_that_the_configuration_says(size):
    crop = CropSpec(context=2.0, size=size)
    config = AuthorsSmallConfig(channels=(32, 32, 32, 32, 64), crop=crop)
    crops = torch.zeros(1, size, size, 3, dtype=torch.uint8)
    assert SmallTrunk(config.channels)(crops).shape == (1, config.embedding)


def test_channels_that_cannot_be_grouped_are_refused():
    with pytest.raises(ValueError, match=r"channels are \(32, 64, 100, .*multiples of 32"):
        AuthorsSmallConfig(channels=(32, 64, 100, 256, 512))


@pytest.mark.parametrize("config", [AuthorsConfig(), AuthorsSmallConfig()])
def test_the_authors_conventions_are_in_the_description(config):
    spec = config.spec()
    assert (spec.look_at_reset, spec.whole_pixels) == (True, True)
    assert (spec.fill, spec.reset_interval, spec.regression_scale) == ((0.0, 0.0, 0.0), 32, 10.0)
    assert spec.previous == spec.current
    assert (spec.current.context, spec.current.size) == (2.0, 227)
