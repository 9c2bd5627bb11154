import numpy as np
import pytest

from re3.result import Result, Status
from re3.video import draw, draw_results
from re3.video.draw import LOST_COLOUR, PALETTE, colour_of


def has(image, colour):
    return bool((image == colour).all(axis=2).any())


def result(box=(40, 30, 30, 30), status=Status.TRACKED, score=0.9, object_id=1, name=None):
    return Result(box, score, status, 0, object_id, name)


@pytest.mark.parametrize("size", [(60, 80), (120, 160), (1080, 1920)])
def test_box_and_label_are_drawn_and_the_input_is_left_alone(size):
    image = np.zeros((*size, 3), np.uint8)
    drawn = draw_results(image, [result()])
    assert not image.any()
    assert has(drawn, PALETTE[0])
    assert drawn.shape == image.shape


def test_objects_differ_in_colour():
    image = np.zeros((200, 200, 3), np.uint8)
    drawn = draw_results(image, [result(object_id=1), result((120, 120, 30, 30), object_id=2)])
    assert has(drawn, colour_of(1))
    assert has(drawn, colour_of(2))
    assert len({colour_of(i) for i in range(1, 11)}) == 10


def test_a_lost_object_is_drawn_as_lost():
    image = np.zeros((200, 200, 3), np.uint8)
    lost = draw_results(image, [result(status=Status.LOST)])
    assert has(lost, LOST_COLOUR)
    assert not has(lost, PALETTE[0])
    uncertain = draw_results(image, [result(status=Status.UNCERTAIN)])
    tracked = draw_results(image, [result(status=Status.TRACKED)])
    assert (uncertain != tracked).any()


@pytest.mark.parametrize(
    "box",
    [
        (-50, -50, 60, 60),  # over the corner
        (190, 190, 60, 60),  # over the other
        (-500, -500, 5, 5),  # wholly outside
        (-1e12, 0, 2e12, 5),  # beyond integers
        (0, 0, 200, 200),  # the whole frame: no room above or below
    ],
)
def test_boxes_anywhere_are_drawn_with_their_label_inside(box):
    drawn = draw_results(np.zeros((200, 200, 3), np.uint8), [result(box)])
    plate = (drawn == PALETTE[0]).all(axis=2)
    assert plate.sum() > 300  # the label's plate is there


def test_a_long_or_foreign_name_does_not_fail():
    image = np.zeros((60, 80, 3), np.uint8)
    draw_results(image, [result(name="ein sehr langer Name für ein Objekt" * 3)])


def test_a_label_is_not_crossed_by_another_box():
    image = np.zeros((200, 200, 3), np.uint8)
    first = result((60, 80, 60, 60), name="first")
    alone = draw_results(image, [first])
    both = draw_results(image, [first, result((50, 40, 100, 100), object_id=2, name="x")])
    top = 80 - 12  # the label of the first lies above its box
    assert (both[top:80, 60:90] == alone[top:80, 60:90]).all()


@pytest.mark.parametrize(
    ("boxes", "size"),
    [
        ([(60, 80, 60, 60)] * 5, (300, 400)),  # one upon the other
        ([(60 + 8 * i, 80 + 3 * i, 40, 50) for i in range(8)], (300, 400)),  # a crowd
        ([(0, 0, 30, 30), (2, 2, 30, 30), (4, 1, 30, 30)], (300, 400)),  # in a corner
        ([(370, 280, 30, 20), (365, 275, 30, 20)], (300, 400)),  # in the other
        ([(-50, 100, 60, 40), (-40, 100, 60, 40)], (300, 400)),  # over the edge
    ],
)
def test_labels_do_not_cover_each_other(monkeypatch, boxes, size):
    shown = [result(box, object_id=i + 1, name=f"object {i}") for i, box in enumerate(boxes)]
    places = []
    place_of = draw._place_of

    def noted(*arguments):
        places.append(place_of(*arguments))
        return places[-1]

    monkeypatch.setattr(draw, "_place_of", noted)
    drawn = draw_results(np.zeros((*size, 3), np.uint8), shown)
    assert len(places) == len(boxes)
    counts = np.zeros(size, int)
    for x, y, width, height in places:
        assert min(x, y) >= 0 and x + width <= size[1] and y + height <= size[0]
        counts[y : y + height, x : x + width] += 1
    assert counts.max() == 1
    # Each plate is whole, in the colour of its object: nothing was drawn over it.
    for each, (x, y, width, _) in zip(shown, places, strict=True):
        edge = drawn[y, x : x + width]
        assert (edge == colour_of(each.object_id)).all()


def test_a_frame_too_full_for_all_labels_is_drawn_all_the_same():
    shown = [result((5, 5, 20, 20), object_id=i + 1, name="a long name") for i in range(30)]
    assert draw_results(np.zeros((60, 80, 3), np.uint8), shown).any()


def test_the_box_is_drawn_on_its_own_pixels():
    drawn = draw_results(np.zeros((200, 200, 3), np.uint8), [result((100, 100, 50, 40))])
    rows, columns = np.nonzero((drawn[100:, 100:] == PALETTE[0]).all(axis=2))
    assert (rows.max() + 1, columns.max() + 1) == (40, 50)


def test_objects_may_be_given_colours_and_a_lost_one_stays_grey():
    image = np.zeros((200, 200, 3), np.uint8)
    shown = [result((20, 40, 60, 60)), result((100, 100, 50, 40), object_id=2)]
    drawn = draw_results(image, shown, {2: (1, 2, 253)})
    assert has(drawn, (1, 2, 253)) and has(drawn, PALETTE[0])
    lost = draw_results(image, [result((20, 40, 60, 60), Status.LOST)], {1: (1, 2, 253)})
    assert has(lost, LOST_COLOUR) and not has(lost, (1, 2, 253))
