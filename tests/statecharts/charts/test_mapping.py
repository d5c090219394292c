"""The chart `map` as tables: what is new and what is known, by integer distance within a class group."""

from __future__ import annotations

import pytest

from statecharts.charts.mapping import _root
from tests.checks import check_chart, check_equal


def test_new_and_known() -> None:
    """Within eight metres it is the same thing, at its newest place; classes of one group are one kind."""
    story = check_chart(
        "map",
        """
        at_s | observe               | say
        0    | frame                 | -
        0    | frame person@-        | -
        0    | frame ball@0,0        | -
        1    | frame person@0,0:50   | new 1
        2    | frame person@8,0:60   | same 1 8000mm
        3    | frame person@12,-3:70 | same 1 5000mm
        4    | frame person@0,0      | new 2
        5    | frame car@0,0         | new 3
        6    | frame truck@0,1       | same 3 1000mm
        """,
        sightings_to_ask=99,
    )
    thing = story.flight.state.objects[1]
    check_equal(
        (thing.sightings, thing.confidence_e4, thing.spot.east_mm, thing.spot.north_mm), (3, 7000, 12000, -3000)
    )
    check_equal((thing.class_name, thing.class_group), ("person", "person"))
    check_equal(story.flight.state.objects[3].class_name, "car")


@pytest.mark.parametrize(
    ("where", "said"),
    [
        ("8,0", "same 1 8000mm"),
        ("8.001,0", "new 2"),
        ("0,-8", "same 1 8000mm"),
        ("0,8", "same 1 8000mm"),
        ("-8,0", "same 1 8000mm"),
        ("5.6,5.6", "same 1 7919mm"),
        ("-5.6,-5.6", "same 1 7919mm"),
        ("0,-8.001", "new 2"),
        ("-4.8,6.4", "same 1 8000mm"),
        ("-4.8,6.401", "new 2"),
        ("-7.999,-0.001", "same 1 7999mm"),
        ("0,0.001", "same 1 1mm"),
        ("0,0", "same 1 0mm"),
    ],
)
def test_the_edge_of_the_limit(where: str, said: str) -> None:
    """Eight metres to the millimetre, in every direction across the cells of the grid."""
    table = f"at_s | observe | say\n0 | frame person@0,0 | new 1\n1 | frame person@{where} | {said}"
    check_chart("map", table, sightings_to_ask=99)


def test_two_in_one_frame_stay_two() -> None:
    """Each takes the nearest thing that is still free; the lower number on a tie; what is left is new."""
    check_chart(
        "map",
        """
        at_s | observe                                      | say
        0    | frame person@0,0 person@1,0                  | new 1, new 2
        1    | frame person@0.9,0 person@0.1,0              | same 2 100mm, same 1 100mm
        2    | frame person@0.5,0                           | same 1 400mm
        3    | frame person@0.7,0                           | same 1 200mm
        4    | frame person@0.8,0                           | same 1 100mm
        5    | frame person@0.85,0                          | same 1 50mm
        6    | frame person@0.9,0 person@0.9,0 person@0.9,0 | same 2 0mm, same 1 50mm, new 3
        """,
        sightings_to_ask=99,
    )


def test_a_tie_goes_to_the_lower_number() -> None:
    """Also where the lower number came into the cell of the grid last."""
    check_chart(
        "map",
        """
        at_s | observe                      | say
        0    | frame person@-6,0 person@4,0 | new 1, new 2
        1    | frame person@-4,0            | same 1 2000mm
        2    | frame person@0,0             | same 1 4000mm
        """,
        sightings_to_ask=99,
    )
    check_chart(
        "map",
        """
        at_s | observe                      | say
        0    | frame person@-1,0 person@6,0 | new 1, new 2
        1    | frame person@2,0             | same 1 3000mm
        2    | frame person@4,0             | same 1 2000mm
        2.1  | frame person@2,0             | same 1 2000mm
        3    | frame person@4,0             | same 1 2000mm
        4    | frame person@5,0             | same 1 1000mm
        """,
        sightings_to_ask=99,
    )


def test_things_that_move_are_found_where_they_are() -> None:
    """A walk over many cells stays one thing, and nothing is left behind where it was."""
    steps = "\n".join(
        f"{number} | frame person@{7 * number},{-7 * number / 2} | same 1 7826mm" for number in range(1, 9)
    )
    table = f"at_s | observe | say\n0 | frame person@0,0 | new 1\n{steps}\n9 | frame person@0,0 | new 2"
    story = check_chart("map", table, sightings_to_ask=99)
    cells = [numbers for _, numbers in story.flight.state.grid.items() if numbers]
    check_equal(sorted(cells), [(1,), (2,)])


@pytest.mark.parametrize("number", [*range(30), 63_999_999, 64_000_000, 64_000_001, 10**18 - 1, 10**18, 2**80 + 1])
def test_the_integer_root(number: int) -> None:
    """The greatest integer whose square is not above it."""
    root = _root(number)
    check_equal((root * root <= number, (root + 1) * (root + 1) > number), (True, True))
