"""The LSTM against a literal transcription of the paper's equations."""

import numpy as np
import pytest
import torch

from re3.network.peephole_lstm import CellState, FactoredLSTM, PeepholeLSTMCell

rng = np.random.default_rng(0)


def sigmoid(x):
    return 1 / (1 + np.exp(-x))


def paper_step(w, x, y, c):
    """Equations 1 to 6 of Re3, sec. III-B, for one object."""
    z = np.tanh(w["Wz"] @ x + w["Rz"] @ y + w["bz"])  # (1)
    i = sigmoid(w["Wi"] @ x + w["Ri"] @ y + w["Pi"] @ c + w["bi"])  # (2)
    f = sigmoid(w["Wf"] @ x + w["Rf"] @ y + w["Pf"] @ c + w["bf"])  # (3)
    c_new = i * z + f * c  # (4)
    o = sigmoid(w["Wo"] @ x + w["Ro"] @ y + w["Po"] @ c_new + w["bo"])  # (5)
    return o * np.tanh(c_new), c_new  # (6)


def matrices(cell):
    units = cell.units
    w = {}
    for index, gate in enumerate("zifo"):
        rows = slice(index * units, (index + 1) * units)
        w["W" + gate] = cell.input_weight[rows]
        w["R" + gate] = cell.recurrent_weight[rows]
        w["b" + gate] = cell.bias[rows]
    w["Pi"], w["Pf"] = cell.peephole_weight[:units], cell.peephole_weight[units:]
    w["Po"] = cell.output_peephole
    return {name: value.detach().double().numpy() for name, value in w.items()}


def random_cell(inputs, units):
    torch.manual_seed(0)
    cell = PeepholeLSTMCell(inputs, units).double()
    torch.nn.init.normal_(cell.bias)
    return cell


@pytest.mark.parametrize(("inputs", "units"), [(5, 3), (3, 7), (1, 1)])
def test_cell_is_equations_1_to_6(inputs, units):
    cell = random_cell(inputs, units)
    y, c = rng.normal(size=units), rng.normal(size=units)
    state = CellState(torch.tensor(y)[None], torch.tensor(c)[None])
    w = matrices(cell)
    for x in rng.normal(size=(4, inputs)):
        y, c = paper_step(w, x, y, c)
        state = cell(torch.tensor(x)[None], state)
        np.testing.assert_allclose(state.output[0].detach(), y, atol=1e-12)
        np.testing.assert_allclose(state.cell[0].detach(), c, atol=1e-12)


def test_output_gate_sees_the_new_cell():
    cell = random_cell(2, 2)
    with torch.no_grad():
        for parameter in cell.parameters():
            parameter.zero_()
        cell.bias[:2] = 10.0  # z = 1
        cell.output_peephole.copy_(100 * torch.eye(2))
    zero = torch.zeros(1, 2, dtype=torch.double)
    state = cell(zero, CellState(zero, zero))
    # c = i z = 0.5, so that o = sigmoid(50) = 1; with the old cell it would be 0.5.
    np.testing.assert_allclose(state.output.detach(), np.tanh([[0.5, 0.5]]), atol=1e-6)


def test_features_feed_both_layers_and_the_first_feeds_the_second():
    torch.manual_seed(0)
    lstm = FactoredLSTM(4, 3).double()
    features = torch.tensor(rng.normal(size=(1, 4)))
    zero = torch.zeros(1, 3, dtype=torch.double)
    output, (first, second) = lstm(features, ((CellState(zero, zero),) * 2))
    y1, c1 = paper_step(matrices(lstm.first), features[0].numpy(), np.zeros(3), np.zeros(3))
    x2 = np.concatenate([features[0].numpy(), y1])
    y2, c2 = paper_step(matrices(lstm.second), x2, np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(output[0].detach(), y2, atol=1e-12)
    for got, expected in ((first.cell, c1), (second.output, y2), (second.cell, c2)):
        np.testing.assert_allclose(got[0].detach(), expected, atol=1e-12)
