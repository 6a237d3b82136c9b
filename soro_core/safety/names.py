"""Names that publishers of commands give, and which of them two publishers give at the same time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

# A busy reader misses fewer messages of one publisher in a row than this.
MISSED = 100


@dataclass(frozen=True)
class Names:
    """Names of the publishers of one topic since the last of its publishers left.

    Attributes
    ----------
    last : mapping of str to int
        Number of the latest message of each name: every publisher counts its own messages, each one higher
        than the one before.
    shared : frozenset of str
        Names that more than one publisher gives.
    """

    last: Mapping[str, int] = field(default_factory=dict)
    shared: frozenset[str] = frozenset()


def note_message(names: Names, name: str, number: int | None, publishers: int) -> Names:
    """Note a message of `name`.

    The messages of one publisher arrive in order, and few are missed. So a number that does not follow the
    last one of its name comes from a second publisher, where there are several; a single one was only started
    again. A name that is shared stays so as long as all publishers are there.

    Parameters
    ----------
    names : Names
        Names before the message.
    name : str
        Name that the message gives of its publisher.
    number : int or None
        Number of the message among those of its publisher; None if the middleware does not give it. Two
        publishers then cannot be distinguished, and every name counts as shared.
    publishers : int
        Present number of publishers of the topic.
    """
    if publishers <= 1:
        return Names({} if number is None else {name: number})
    last = names.last.get(name)
    goes_on = number is not None and (last is None or last < number <= last + MISSED)
    numbers = names.last if number is None else {**names.last, name: number}
    return Names(numbers, names.shared if goes_on else names.shared | {name})
