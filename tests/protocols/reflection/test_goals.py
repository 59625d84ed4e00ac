"""The book of goals: identifiers say how new and how good a report is, and no report goes round for ever."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.reflection.goals import GoalBook, Verdict, goal_number, handlings


def test_identifiers_of_the_paper() -> None:
    """Team of 5: the third goal is 15 from its owner, 14 from the first who passes it on."""
    assert [goal_number(identifier, 5) for identifier in (1, 5, 6, 11, 14, 15, 16)] == [1, 1, 2, 3, 3, 3, 4]
    assert [handlings(identifier, 5) for identifier in (15, 14, 11)] == [0, 1, 4]
    book = GoalBook(0, 5)
    book.set_own(3, 1.0, 2.0)
    assert book.sent_as(0) == 15
    assert book.number(0) == 3


def test_a_goal_is_passed_on_with_one_less_and_not_beyond_the_team() -> None:
    book = GoalBook(1, 3)
    told = []
    for identifier in (6, 5, 4):
        book = GoalBook(1, 3)
        book.consider(0, identifier, 0.0, 0.0)
        told.append(book.sent_as(0))
    assert told == [5, 4, 0]


def test_equal_identifiers_refresh_better_ones_replace_and_worse_ones_are_refused() -> None:
    book = GoalBook(1, 4)
    assert book.consider(0, 7, 1.0, 0.0) is Verdict.NEW
    assert book.consider(0, 7, 2.0, 0.0) is Verdict.REFRESHED
    assert book.x_m[0] == 2.0
    assert book.consider(0, 6, 3.0, 0.0) is Verdict.REFUSED
    assert book.consider(0, 8, 4.0, 0.0) is Verdict.REFRESHED  # the owner itself
    assert book.consider(0, 9, 5.0, 0.0) is Verdict.NEW  # its third goal, by three others
    assert (book.x_m[0], book.number(0)) == (5.0, 3)


def test_nobody_knows_better_about_my_goal_than_i() -> None:
    book = GoalBook(0, 2)
    book.set_own(1, 1.0, 1.0)
    assert book.consider(0, 100, 9.0, 9.0) is Verdict.REFUSED
    assert book.x_m[0] == 1.0
    book.clear_own()
    assert book.known == []


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(1, 40)), max_size=40))
def test_an_older_goal_never_replaces_a_newer_one(reports: list[tuple[int, int]]) -> None:
    book = GoalBook(3, 4)
    newest = dict.fromkeys(range(4), 0)
    for owner, identifier in reports:
        before = book.number(owner) if book.identifiers[owner] else 0
        verdict = book.consider(owner, identifier, float(identifier), 0.0)
        number = book.number(owner) if book.identifiers[owner] else 0
        assert number >= before
        if owner != 3:
            newest[owner] = max(newest[owner], identifier)
            assert book.identifiers[owner] == newest[owner]
            assert (verdict is Verdict.NEW) == (number > before)


@given(
    st.integers(2, 6),
    st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5), st.integers(0, 4)), max_size=120),
)
def test_reports_stop_going_round_for_any_team_order_and_delay(team: int, meetings: list[tuple[int, int, int]]) -> None:
    """Frames are delivered in any order, any number of times: what is told stays true of the owner's goal it names.

    The place of goal k is the number k: a loop that took an old goal for a new one would show as a wrong place.
    """
    books = [GoalBook(robot, team) for robot in range(team)]
    books[0].set_own(1, 1.0, 0.0)
    sent: list[tuple[int, int, float]] = []
    number = 1
    for sender, receiver, old in meetings:
        sender, receiver = sender % team, receiver % team
        if sender == receiver:
            number += 1
            books[0].set_own(number, float(number), 0.0)
            continue
        book = books[sender]
        if book.identifiers[0] and book.sent_as(0):
            sent.append((sender, book.sent_as(0), book.x_m[0]))
        for author, identifier, place in sent[-1 - old :][:1]:
            if author != receiver:
                books[receiver].consider(0, identifier, place, 0.0)
    for book in books:
        if book.identifiers[0]:
            assert book.x_m[0] == book.number(0)
            assert book.number(0) <= number
            assert handlings(book.identifiers[0], team) < team


@pytest.mark.parametrize("team", [2, 3, 7])
def test_along_a_line_of_robots_the_identifier_counts_the_hops(team: int) -> None:
    books = [GoalBook(robot, team) for robot in range(team)]
    books[0].set_own(4, 1.0, 1.0)
    for one, other in pairwise(books):
        assert other.consider(0, one.sent_as(0), 1.0, 1.0) is Verdict.NEW
    assert [handlings(book.identifiers[0], team) for book in books] == [0, *range(team - 1)]
