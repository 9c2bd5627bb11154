import pytest

pytest.importorskip("torch", reason="the networks need torch (the train extra)")
