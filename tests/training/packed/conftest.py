"""Packed training data small enough for a test."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

pytest.importorskip("torch", reason="training needs torch (the train extra)")
import torch
from packed_material import make_sources

from re3.data.mix import Mix
from re3.data.packed.pack import PackConfig, pack
from re3.data.packed.shards import read_shards
from re3.data.photometric_config import NO_EFFECTS
from re3.data.sampling_config import SamplingConfig
from re3.training.packed.bank import fill_bank
from re3.training.packed.index import index_shards


@pytest.fixture(scope="session")
def sources(tmp_path_factory):
    return make_sources(tmp_path_factory.mktemp("unpacked"))


@pytest.fixture(scope="session")
def packed(sources, tmp_path_factory):
    """The folder of the shards: as fine as the encoder can, in shards of few kilobytes."""
    folder = tmp_path_factory.mktemp("shards")
    mix = Mix((), replace(SamplingConfig(), photometric=NO_EFFECTS))
    with ThreadPoolExecutor(2) as pool:
        pack(mix, sources, folder, PackConfig(quality=95, shard_mb=0.01), pool)
    return folder


@pytest.fixture(scope="session")
def index(packed):
    return index_shards(read_shards(packed), smallest=5.0)


@pytest.fixture(scope="session")
def bank(index):
    with ThreadPoolExecutor(2) as pool:
        return fill_bank(index.image_sizes, index.pictures(pool), torch.device("cpu"))
