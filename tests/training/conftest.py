import pytest

pytest.importorskip("torch", reason="training needs torch (the train extra)")

from tiny import TinySampler


@pytest.fixture
def sampler():
    return TinySampler()
