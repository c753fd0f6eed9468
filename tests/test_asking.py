"""Computations that ask: answers, errors and results go where they belong."""

import pytest

from orchestrator.study.requests import answered, translated


def adds(*numbers):
    """The sum of the answers to ``numbers``; an answer that is no number counts as 100."""
    total = 0
    for number in numbers:
        try:
            total += yield number
        except ValueError:
            total += 100
    return total


def test_answers_and_errors_are_sent_to_where_they_were_asked_for():
    assert answered(adds(1, 2, 3), lambda number: 10 * number) == 60
    assert answered(adds(), lambda number: 1) == 0

    def fails_at_two(number):
        if number == 2:
            raise ValueError("two")
        return number

    assert answered(adds(1, 2, 3), fails_at_two) == 104


def test_what_is_not_caught_ends_the_computation():
    closed = []

    def asking():
        try:
            yield 1
        finally:
            closed.append(True)

    def interrupt(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        answered(asking(), interrupt)
    assert closed == [True]


def test_one_computation_asks_for_another():
    def squared(number):
        root = yield f"root of {number}"
        return root * root

    asked = []
    assert answered(translated(adds(4, 9), squared), lambda text: asked.append(text) or len(text)) == 2 * 9 * 9
    assert asked == ["root of 4", "root of 9"]
