"""Who may order what: every role, every kind of order, every configuration (docs/orders.md, Roles)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import pytest

from tests.checks import check_chart, check_equal
from tests.stories import Story

ROLES = ("viewer", "operator", "supervisor", "admin")
CAMERA = {"point": "intended", "turn": "intended", "release": "intended", "confirm p1": "rejected"}  # no such finding
UNKNOWN = "dance"  # what comes of it where it is permitted is "unsupported"
LISTS: tuple[tuple[str, ...], ...] = ((), ("operator",), ("operator", "supervisor", "admin"), ("admin",), ROLES)


def outcome_of(verb: str, roles: Sequence[str], **limits: object) -> str:
    """Return the state that an order is in after its arrival."""
    story = Story(**limits)
    story.tell(f"order a {verb} roles={','.join(roles)}")
    return story.flight.state.orders["alpha/a"].state


def expected_of(verb: str, role: str, camera: Sequence[str], flight: Sequence[str]) -> str:
    """Return what the matrix of the documentation says."""
    if verb == UNKNOWN:
        return "unsupported" if role in camera or role in flight else "unauthorised"
    return CAMERA[verb] if role in camera else "unauthorised"


@pytest.mark.parametrize("verb", [*CAMERA, UNKNOWN])
def test_the_matrix(verb: str) -> None:
    """Each role alone, on each pair of lists; the list of the flight never opens the camera."""
    for role, camera, flight in itertools.product(ROLES, LISTS, LISTS):
        found = outcome_of(verb, [role], camera_roles=camera, flight_roles=flight)
        assert found == expected_of(verb, role, camera, flight), (role, camera, flight)
        assert outcome_of(verb, [], camera_roles=camera, flight_roles=flight) == "unauthorised"


@pytest.mark.parametrize("verb", [*CAMERA, UNKNOWN])
@pytest.mark.parametrize("role", ROLES)
def test_switched_off_nobody_may(verb: str, role: str) -> None:
    """Reception is off by default, and then no role helps."""
    check_equal(outcome_of(verb, [role], camera_roles=ROLES, flight_roles=ROLES, command_enabled=False), "unsupported")


def test_roles_count_by_their_exact_name() -> None:
    """No role contains another, no prefix counts, and case matters."""
    for role in ("operators", "oper", "Operator", "admin,operato"):
        check_equal(outcome_of("point", role.split(","), camera_roles=["operator"]), "unauthorised")
    check_equal(outcome_of("point", ["admin", "operator"], camera_roles=["operator"]), "intended")


def test_a_role_that_is_not_there_is_told_so_once_and_for_all() -> None:
    """The answer is final, also where the list would allow the role by another order."""
    check_chart(
        "command",
        """
        at_s | observe                      | say                  | why
        0    | order a point roles=pilot    | a unauthorised       | role not permitted
        1    | again a                      | a unauthorised again | role not permitted
        2    | order b point roles=operator | look 1,1             | all gates passed
        """,
        camera_roles=["operator"],
        flight_roles=["pilot"],
    )
