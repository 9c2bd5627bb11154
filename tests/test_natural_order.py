from hypothesis import given
from hypothesis import strategies as st

from re3.natural_order import natural_key


@given(st.lists(st.integers(0, 10**6), min_size=1), st.text(alphabet="abz_-. "))
def test_natural_order_is_that_of_the_numbers(numbers, stem):
    names = [f"{stem}x{number}y" for number in numbers]
    assert sorted(names, key=natural_key) == [f"{stem}x{number}y" for number in sorted(numbers)]


def test_natural_key_compares_any_two_names():
    # Names that begin with a digit must sort against names that do not.
    assert sorted(["a", "2", "10", "B", ""], key=natural_key) == ["", "2", "10", "a", "B"]
