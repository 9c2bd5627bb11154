"""Every format of sequences as a source to train on."""

import layouts
import numpy as np
import pytest

from re3.data.formats import find_format, looks_like_clips, read_dataset
from re3.data.formats.alov import IN_VOT2014
from re3.data.frame_store import FrameStore
from re3.data.mix import Mix, MixSource, mix_sampler
from re3.data.sampling_config import SamplingConfig
from re3.data.still_formats import find_stills

# Objects of the layouts are a few pixels large.
TINY = SamplingConfig(smallest=1.0, mirrored=0.0)


@pytest.mark.parametrize("name", layouts.BUILDERS)
def test_clips_can_be_drawn_from_it(tmp_path, name):
    folder = layouts.BUILDERS[name](tmp_path / "data")
    if name == "lasot":  # of which one frame is left in sight otherwise
        layouts.text(folder / "cat" / "cat-1" / "out_of_view.txt", "0,0,0")
    mix = Mix((MixSource(folder, "videos", "mine"),), TINY)
    sampler = mix_sampler(mix, FrameStore(tmp_path / "store"))
    for seed in range(6):
        clip = sampler.sample(3, np.random.default_rng(seed))
        assert clip.origin.source == "mine"
        assert not np.isnan(clip.boxes_xyxy[0]).any()
        assert clip.crop(2, (0, 0, 32, 24), 16).shape == (16, 16, 3)


@pytest.mark.parametrize("name", layouts.BUILDERS)
def test_it_is_told_from_stills(tmp_path, name):
    folder = layouts.BUILDERS[name](tmp_path / "data")
    assert looks_like_clips(folder) == (name != "plain")
    # Nothing in it is taken for annotated stills.
    assert [known.name for known, _ in find_stills(folder)] == ["images"]


def test_frames_between_the_annotated_ones_of_alov_are_not_absent(tmp_path):
    folder = layouts.alov(tmp_path)
    (looked_at,) = read_dataset(folder)
    (trained,) = read_dataset(folder, training=True)
    assert np.isnan(looked_at.boxes_xywh[1]).all()
    assert not np.isnan(trained.boxes_xywh).any()
    assert find_format(folder, training=True).name == "alov-interpolated"


def test_what_is_in_vot_2014_is_not_trained_on(tmp_path):
    folder = layouts.alov(tmp_path)
    for name in sorted(IN_VOT2014):
        category = name.rpartition("_")[0]
        layouts.images(folder / "imagedata++" / category / name, 2, digits=8)
        layouts.text(
            folder / "annotations" / category / f"{name}.ann",
            "1 11 7 5 7 5 3 11 3",
            "2 11 7 5 7 5 3 11 3",
        )
    assert len(IN_VOT2014) == 7
    assert len(read_dataset(folder)) == 8
    for format_name in (None, "alov", "alov-interpolated"):
        (left,) = read_dataset(folder, format_name, training=True)
        assert left.name == "01-Light_video00001"
