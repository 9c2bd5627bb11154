"""Crops made in batches are those of the unpacked path, and boxes fit what is drawn."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from re3 import geometry
from re3.data.photometric_config import NO_EFFECTS
from re3.data.sampling_config import SamplingConfig
from re3.data.simulation_config import SimulationConfig
from re3.training.packed.clips import ABSENT, BACKGROUND, LAYERS, TARGET
from re3.training.packed.draw import ClipDrawer
from re3.training.packed.photometric import blur, compress
from re3.training.packed.rollout import Renderer, decode, encode, search_region

PLAIN = SamplingConfig(
    mirrored=0, reversed=0, leaps=0, strides=(1,), simulated=0, photometric=NO_EFFECTS
)
ALONE = SimulationConfig(
    occluders=0, twin=0, other=0, camera=(0.003, 0.003), object_pixels=(60, 90)
)


@pytest.fixture
def generator():
    return torch.Generator().manual_seed(0)


@pytest.mark.parametrize(
    "region",
    [
        (40.0, 20.0, 100.0, 80.0),  # enlarged
        (-30.0, -10.0, 90.0, 110.0),  # over the border
        (-200.0, -250.0, 400.0, 350.0),  # shrunk by six
        (20.0, 10.0, 150.0, 40.0),  # stretched
    ],
)
def test_crops_of_a_frame_are_those_of_geometry(index, bank, generator, region):
    clips = ClipDrawer(index, PLAIN).draw(2, 3, np.random.default_rng(0))
    size = 96
    regions = torch.tensor([region, region])
    crops = Renderer(bank, 127.0).crops(clips, 1, regions, size, generator)
    for row in range(2):
        offset = int(bank.offsets[clips.image[1, row, 0], 0])
        pixels = bank.pixels[offset : offset + 160 * 96].view(torch.uint8).view(96, 160, 4)
        frame = np.ascontiguousarray(pixels[..., :3].numpy())
        wanted = geometry.crop(frame, region, size, (127.0,) * 3)
        difference = np.abs(crops[row].numpy() - wanted.astype(np.float64))
        # At the border OpenCV blends with the fill colour over a pixel.
        assert np.quantile(difference, 0.9) <= 3
        assert difference.mean() < 3


def test_mirrored_clips_show_mirrored_crops(index, bank, generator):
    renderer = Renderer(bank, 127.0)
    both = []
    for mirrored in (0.0, 1.0):
        drawer = ClipDrawer(index, replace(PLAIN, mirrored=mirrored))
        clips = drawer.draw(2, 2, np.random.default_rng(3))
        regions = search_region(clips.boxes_xyxy[0], 2.0)
        both.append(renderer.crops(clips, 0, regions, 64, generator))
    assert (both[0] - both[1].flip(2)).abs().mean() < 1


@pytest.mark.parametrize("bending", [0.0, 0.06])
def test_boxes_of_simulated_objects_fit_their_pixels(index, bank, generator, bending):
    simulation = replace(ALONE, bent=1.0, bending=bending)
    drawer = ClipDrawer(index, replace(PLAIN, simulated=1.0, simulation=simulation))
    clips = drawer.draw(6, 3, np.random.default_rng(1))
    # The target is green; before a frame of the film, nothing else is.
    image = clips.image.clone()
    image[..., BACKGROUND] = 0
    alone = replace(clips, image=image)
    renderer = Renderer(bank, 127.0)
    whole = torch.cat([torch.zeros_like(clips.size), clips.size], dim=1)
    for t in range(3):
        crops = renderer.crops(alone, t, whole, 192, generator)
        boxes = encode(clips.boxes_xyxy[t], whole) / geometry.REGRESSION_SCALE * 192
        for row in range(6):
            if boxes[row].isnan().any():
                continue
            image = crops[row].numpy()
            shown = (image[..., 1] > 150) & (image[..., 2] < 100)
            rows, columns = np.nonzero(shown)
            found = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            side = float((boxes[row, 2:] - boxes[row, :2]).max())
            np.testing.assert_allclose(found, boxes[row].numpy(), atol=2.5 + 0.06 * side)


def test_occluded_objects_are_counted_as_such(index, bank):
    simulation = replace(ALONE, occluders=6.0, room=(2.0, 2.5))
    drawer = ClipDrawer(index, replace(PLAIN, simulated=1.0, simulation=simulation))
    clips = drawer.draw(16, 10, np.random.default_rng(2))
    share = Renderer(bank, 127.0).visible(clips)
    assert share.shape == (10, 16)
    assert ((share >= 0) & (share <= 1)).all()
    assert (share < 0.6).any()
    none = torch.cat(
        [clips.opaque[:, : TARGET + 1], torch.full((16, LAYERS - TARGET - 1), ABSENT)], dim=1
    )
    present = ~clips.boxes_xyxy[..., 0].isnan()
    assert (Renderer(bank, 127.0).visible(replace(clips, opaque=none))[present] == 1).all()


@pytest.mark.parametrize("way", ["walks", "camera", "behind"])
def test_objects_leave_the_scene(index, bank, generator, way):
    simulation = replace(ALONE, leaves=1.0, leaves_by=(way,), bent=0, foreign=1.0)
    drawer = ClipDrawer(index, replace(PLAIN, simulated=1.0, simulation=simulation))
    clips = drawer.draw(12, 12, np.random.default_rng(4))
    absent = clips.boxes_xyxy[..., 0].isnan()
    assert not absent[0].any()
    assert absent.any(dim=0).all()  # each of them goes
    back = absent[:-1] & ~absent[1:]
    assert 0 < back.any(dim=0).float().mean() < 1  # some of them come back
    # Nothing of a target is seen in a frame that has no box for it: most of one, at most.
    renderer = Renderer(bank, 127.0)
    without = replace(clips, opaque=clips.opaque.clone())
    without.opaque[:, TARGET] = ABSENT
    whole = torch.cat([torch.zeros_like(clips.size), clips.size], dim=1)
    for t in range(12):
        seen = renderer.crops(clips, t, whole, 64, generator)
        hidden = renderer.crops(without, t, whole, 64, generator)
        changed = ((seen - hidden).abs().amax(dim=-1) > 30).float().mean(dim=(1, 2))
        present = (clips.boxes_xyxy[t, :, 2:] - clips.boxes_xyxy[t, :, :2]).prod(dim=1)
        share = present / clips.size.prod(dim=1)
        gone = absent[t]
        assert (changed[gone] < 0.15 * share.nan_to_num(0.0).max() + 0.02).all()


def test_objects_are_there_when_clips_begin(index):
    drawer = ClipDrawer(index, SamplingConfig(simulated=0.5))
    clips = drawer.draw(64, 5, np.random.default_rng(0))
    assert not clips.boxes_xyxy[0].isnan().any()
    assert not clips.boxes_xyxy[1][clips.leaps].isnan().any()
    assert 0.2 < clips.leaps.float().mean() < 0.8


def test_the_same_generator_gives_the_same_clips(index):
    drawer = ClipDrawer(index, SamplingConfig(simulated=0.5))
    first, again = (drawer.draw(8, 4, np.random.default_rng(7)) for _ in range(2))
    for name, value in vars(first).items():
        torch.testing.assert_close(value, getattr(again, name), equal_nan=True, rtol=0, atol=0)


def test_regions_and_corners_are_those_of_geometry():
    boxes = np.array([[10.0, 20.0, 40.0, 90.0], [5.0, 5.0, 5.2, 6.0]])
    regions = geometry.search_region(boxes, 3.0)
    np.testing.assert_allclose(search_region(torch.from_numpy(boxes), 3.0), regions)
    moved = boxes + 3.0
    corners = geometry.encode(moved, regions)
    np.testing.assert_allclose(encode(torch.from_numpy(moved), torch.from_numpy(regions)), corners)
    back = decode(torch.from_numpy(corners), torch.from_numpy(regions))
    np.testing.assert_allclose(back, moved)


def test_blur_is_that_of_a_filter():
    crops = torch.rand(3, 32, 32, 3) * 255
    kernel = np.outer(*[cv2.getGaussianKernel(11, 1.2)] * 2).astype(np.float32)
    blurred = blur(crops, torch.tensor([2]), torch.from_numpy(kernel)[None])
    torch.testing.assert_close(blurred[:2], crops[:2])
    wanted = cv2.filter2D(crops[2].numpy(), -1, kernel, borderType=cv2.BORDER_REPLICATE)
    np.testing.assert_allclose(blurred[2].numpy(), wanted, atol=0.01)


def test_compression_is_like_that_of_jpeg():
    rng = np.random.default_rng(0)
    picture = cv2.resize(rng.integers(0, 255, (12, 12, 3), dtype=np.uint8), (96, 96))
    crops = torch.from_numpy(np.stack([picture] * 3)).float()
    out = compress(crops, torch.tensor([0, 2]), torch.tensor([100.0, 25.0]))
    torch.testing.assert_close(out[:2], crops[:2], atol=1e-3, rtol=0)
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 25])
    error = np.abs(cv2.imdecode(data, cv2.IMREAD_COLOR).astype(float) - picture).mean()
    ours = float((out[2] - crops[2]).abs().mean())
    assert 0.4 * error < ours < 1.6 * error
