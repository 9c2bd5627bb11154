"""Convolutions of CaffeNet, AlexNet and GoogLeNet: what they compute, and where they go."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from torch.nn import functional as F
from typer.testing import CliRunner
from weight_files import caffemodel, random_arrays

from re3.apps.cli import app
from re3.network.importers import import_file
from re3.network.importers.convolutions import GOOGLENET, KINDS
from re3.network.variants import VARIANTS, build
from re3.network.weights import load_network

CAFFENET = {
    "conv1": (96, 3, 11, 11),
    "conv2": (256, 48, 5, 5),
    "conv3": (384, 256, 3, 3),
    "conv4": (384, 192, 3, 3),
    "conv5": (256, 192, 3, 3),
    "fc8": (10, 20),  # of the classifier, left out
}
ALEXNET = {
    "features.0": (64, 3, 11, 11),
    "features.3": (192, 64, 5, 5),
    "features.6": (384, 192, 3, 3),
    "features.8": (256, 384, 3, 3),
    "features.10": (256, 256, 3, 3),
    "classifier.6": (10, 20),
}
POOL5 = 6 * 6 * 256


@pytest.fixture(autouse=True)
def fewer_units(monkeypatch):
    sizes = {"fully_connected": 24, "lstm_units": 16}
    for name in ("re3", "re3-alexnet"):
        monkeypatch.setitem(VARIANTS, name, replace(VARIANTS[name], **sizes))


def arrays_of(layers):
    shapes = {f"{name}.weight": shape for name, shape in layers.items()}
    shapes |= {f"{name}.bias": shape[:1] for name, shape in layers.items()}
    return random_arrays(shapes)


def write_caffenet(path, *, first=("pool1", "norm1"), layers=CAFFENET, **options):
    """All of a net: layers without weights as well, in their order."""
    arrays = arrays_of(layers)
    blobs = [(n, (arrays[f"{n}.weight"], arrays[f"{n}.bias"])) for n in layers]
    net = [blobs[0], *((name, ()) for name in first), *blobs[1:]]
    path.write_bytes(caffemodel(net, **options))
    return {name: torch.from_numpy(array) for name, array in arrays.items()}


def random_crops(count=1):
    crops = np.random.default_rng(1).integers(0, 256, (count, 227, 227, 3), dtype=np.uint8)
    return torch.from_numpy(crops)


@pytest.mark.parametrize("old", [False, True], ids=["now", "V1"])
def test_caffenet_computes_on_bgr_what_caffe_does(tmp_path, old):
    path = tmp_path / "net.caffemodel"
    w = write_caffenet(path, old=old)
    imported = import_file(path)
    assert imported.network.config.name == "re3"
    assert imported.values == sum(v.numel() for n, v in w.items() if n.startswith("conv"))
    crops = random_crops()
    mean_bgr = torch.tensor([103.062623801, 115.902882574, 123.151630838])[:, None, None]
    x = crops.permute(0, 3, 1, 2).float() - mean_bgr
    for layer, options in (("conv1", {"stride": 4}), ("conv2", {"padding": 2, "groups": 2})):
        x = F.conv2d(x, w[f"{layer}.weight"], w[f"{layer}.bias"], **options)
        x = F.local_response_norm(F.max_pool2d(F.relu(x), 3, 2), 5, 1e-4, 0.75, 1.0)
    for layer, groups in (("conv3", 1), ("conv4", 2), ("conv5", 2)):
        x = F.conv2d(x, w[f"{layer}.weight"], w[f"{layer}.bias"], padding=1, groups=groups)
        x = F.relu(x)
    expected = F.max_pool2d(x, 3, 2).flatten(1)
    with torch.no_grad():
        found = imported.network.trunk(crops)[:, -POOL5:]
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-3)
    assert expected.std() > 1


def test_alexnet_computes_what_torchvision_does(tmp_path):
    w = {name: torch.from_numpy(array) for name, array in arrays_of(ALEXNET).items()}
    torch.save(w, tmp_path / "alexnet.pth")
    imported = import_file(tmp_path / "alexnet.pth")
    assert imported.network.config.name == "re3-alexnet"
    crops = random_crops()
    found = imported.network.trunk(crops)[:, -POOL5:].detach()
    torch.testing.assert_close(found, alexnet_pool5(w, crops), rtol=1e-4, atol=1e-5)
    assert found.std() > 0.01


def alexnet_pool5(w, crops):
    mean, std = torch.tensor([[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]])[..., None, None]
    x = (crops.flip(3).permute(0, 3, 1, 2) / 255 - mean) / std
    for place, pooled, options in (
        (0, True, {"stride": 4, "padding": 2}),
        (3, True, {"padding": 2}),
        (6, False, {"padding": 1}),
        (8, False, {"padding": 1}),
        (10, True, {"padding": 1}),
    ):
        x = F.relu(
            F.conv2d(x, w[f"features.{place}.weight"], w[f"features.{place}.bias"], **options)
        )
        x = F.max_pool2d(x, 3, 2) if pooled else x
    return x.flatten(1)


def test_the_real_alexnet_goes_in(shared_data):
    path = shared_data.parent / "weights" / "alexnet_torchvision_features.safetensors"
    if not path.is_file():
        pytest.skip(f"needs torchvision's AlexNet: {path} does not exist")
    trunk = import_file(path).network.trunk
    # Filters trained on pictures are smooth: neighbours are alike. Misread ones would not be.
    first = trunk.conv[0].weight.detach()
    neighbours = (first[..., 1:] * first[..., :-1]).mean() / (first**2).mean()
    assert neighbours > 0.3  # 0.57; of random ones 0


def test_the_command_writes_a_network_to_start_from(tmp_path):
    write_caffenet(tmp_path / "net.caffemodel")
    command = ["weights", "import", tmp_path / "net.caffemodel", "--into", "re3", "--seed", "3"]
    result = CliRunner().invoke(app, [str(word) for word in (*command, "--out", tmp_path)])
    assert result.exit_code == 0, result.output
    assert "CaffeNet (Caffe), 2.3 M values" in " ".join(result.output.split())
    network = load_network(tmp_path / "re3-start.safetensors")
    assert network.config == VARIANTS["re3"]
    again = import_file(tmp_path / "net.caffemodel", seed=3).network.state_dict()
    other = import_file(tmp_path / "net.caffemodel", seed=4).network.state_dict()
    for name, value in network.state_dict().items():
        assert torch.equal(value, again[name]), name
    assert torch.equal(again["trunk.conv.1.weight"], other["trunk.conv.1.weight"])
    assert not torch.equal(again["fully_connected.weight"], other["fully_connected.weight"])


def test_importing_leaves_the_random_numbers_of_the_caller_alone(tmp_path):
    write_caffenet(tmp_path / "net.caffemodel")
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    import_file(tmp_path / "net.caffemodel")
    assert torch.equal(torch.rand(1), expected)


def test_googlenet_has_57_convolutions_that_are_renamed():
    (kind,) = (kind for kind in KINDS if "GoogLeNet" in kind.name)
    with torch.device("meta"):
        network = build("re3")
    shapes = kind.shapes(network)
    assert len(GOOGLENET) == 57
    for name, shape in {  # from Table 1 of the GoogLeNet paper
        "conv1/7x7_s2.weight": (64, 3, 7, 7),
        "conv2/3x3.bias": (192,),
        "inception_3a/5x5_reduce.weight": (16, 192, 1, 1),
        "inception_4a/1x1.weight": (192, 480, 1, 1),
        "inception_5b/3x3.weight": (384, 192, 3, 3),
        "inception_5b/pool_proj.weight": (128, 832, 1, 1),
    }.items():
        assert shapes[name] == shape
    tensors = {name: torch.from_numpy(a) for name, a in random_arrays(shapes).items()}
    assert kind.recognises(tensors)
    values = kind.convert(tensors, network)
    assert len(values) == len(tensors)
    torch.testing.assert_close(
        values["conv1.weight"], tensors["conv1/7x7_s2.weight"][:, [2, 1, 0]], rtol=0, atol=0
    )
    assert values["inception.4c.five.bias"] is tensors["inception_4c/5x5.bias"]


@pytest.mark.skipif("paper-K" not in VARIANTS, reason="needs the network with GoogLeNet")
def test_googlenet_computes_on_bgr_what_caffe_does(tmp_path, monkeypatch):
    sizes = {"fully_connected": 24, "lstm_units": 16}
    monkeypatch.setitem(VARIANTS, "paper-K", replace(VARIANTS["paper-K"], **sizes))
    layers = {c.layer: c.shape for c in GOOGLENET}
    w = write_caffenet(tmp_path / "net.caffemodel", first=(), layers=layers)
    imported = import_file(tmp_path / "net.caffemodel")
    assert imported.network.config.name == "paper-K"
    crops = random_crops()

    def conv(x, layer, **options):
        return F.relu(F.conv2d(x, w[f"{layer}.weight"], w[f"{layer}.bias"], **options))

    def pool(x):
        return F.max_pool2d(x, 3, 2, ceil_mode=True)

    def norm(x):
        return F.local_response_norm(x, 5, 1e-4, 0.75, 1.0)

    x = crops.permute(0, 3, 1, 2).float() - torch.tensor([104.0, 117.0, 123.0])[:, None, None]
    x = norm(pool(conv(x, "conv1/7x7_s2", stride=2, padding=3)))
    x = pool(norm(conv(conv(x, "conv2/3x3_reduce"), "conv2/3x3", padding=1)))
    for name in ("3a", "3b", "pool", "4a", "4b", "4c", "4d", "4e", "pool", "5a", "5b"):
        if name == "pool":
            x = pool(x)
            continue
        module = f"inception_{name}"
        branches = (
            conv(x, f"{module}/1x1"),
            conv(conv(x, f"{module}/3x3_reduce"), f"{module}/3x3", padding=1),
            conv(conv(x, f"{module}/5x5_reduce"), f"{module}/5x5", padding=2),
            conv(F.max_pool2d(x, 3, 1, padding=1), f"{module}/pool_proj"),
        )
        x = torch.cat(branches, dim=1)
    with torch.no_grad():
        found = imported.network.trunk(crops)[:, -1024:]
    torch.testing.assert_close(found, x.mean(dim=(2, 3)), rtol=1e-4, atol=1e-4)
    assert found.std() > 0.01


@pytest.mark.parametrize(
    ("options", "into", "message"),
    [
        ({"first": ("norm1", "pool1")}, None, r"Caffe's AlexNet \('made'\).*expected CaffeNet"),
        (
            {"layers": {**CAFFENET, "conv3": (384, 128, 3, 3)}},
            None,
            r"conv3\.weight is \(384, 128, 3, 3\) and not \(384, 256, 3, 3\)",
        ),
        (
            {"layers": {n: s for n, s in CAFFENET.items() if n != "conv4"}},
            None,
            r"looks like CaffeNet .*missing: conv4\.weight, conv4\.bias$",
        ),
        ({}, "re3-lite", "not those of 're3-lite'; expected --into one of re3, re3-authors"),
        ({}, "re4", "unknown variant 're4'"),
    ],
    ids=["AlexNet", "shape", "missing", "other trunk", "unknown"],
)
def test_convolutions_that_do_not_fit_are_refused(tmp_path, options, into, message):
    path = tmp_path / "net.caffemodel"
    write_caffenet(path, **options)
    with pytest.raises(ValueError, match=message):
        import_file(path, into)


def test_convolutions_of_another_network_are_refused(tmp_path):
    save_file(
        {name: torch.from_numpy(a) for name, a in arrays_of(ALEXNET).items()},
        tmp_path / "alexnet.safetensors",
    )
    with pytest.raises(ValueError, match=r"AlexNet \(torchvision\), which are not those of 're3'"):
        import_file(tmp_path / "alexnet.safetensors", "re3")
