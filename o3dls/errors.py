"""Errors a user can fix; each message says what is wrong, where, and what would be right."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass


class O3dlsError(Exception):
    """This is the base of every error that o3dls raises on purpose; the command line turns it into one line
    and exit code 2.
    """


class InputError(O3dlsError):
    """A file or an argument holds something that cannot be used."""


@dataclass(frozen=True)
class Answer:
    """An answer ends a doubt: it has what a person reads, and the settings that say the same as keys of
    case.toml, keywords and options.
    """

    words: str
    settings: Mapping[str, str | int | float | bool]


class Doubt(InputError):
    """A doubt is an error that one more setting ends. Who reads it is told `said; advice`, where the advice
    names options; who can be asked is asked `said`, with the answers.
    """

    def __init__(self, said: str, advice: str = "", answers: Sequence[Answer] = ()) -> None:
        super().__init__(f"{said}; {advice}" if advice else said)
        self.question, self.answers = said, tuple(answers)

    def record(self) -> dict[str, object]:
        """Return question and answers as plain values."""
        answers = [{"words": one.words, "settings": dict(one.settings)} for one in self.answers]
        return {"question": self.question, "answers": answers}


def choices(key: str, values: Sequence[str | int], words: str = "{}") -> list[Answer]:
    """Return an answer for each value of a setting; words: what each says."""
    return [Answer(words.format(value), {key: value}) for value in values]


class PipelineError(O3dlsError):
    """A pipeline names a stage, a parameter or an estimate that cannot be; `args` holds one sentence per
    mistake.
    """

    def __str__(self) -> str:
        return "; ".join(map(str, self.args))


class SolverError(O3dlsError):
    """A solver met a state that it cannot leave, such as a value that is not finite."""


def did_you_mean(word: str, known: list[str]) -> str:
    """Return `: did you mean 'x'?` for the closest of the known words, else a list of them."""
    from difflib import get_close_matches

    close = get_close_matches(word, known, n=1)
    return f": did you mean '{close[0]}'?" if close else f"; there are: {', '.join(sorted(known))}"


# what a terminal obeys, what ends a line, and what turns the direction of the text around it
CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")


def escaped(text: str) -> str:
    """The text on one line that says what it holds: control characters as in a literal of Python."""
    return CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def escaped_lines(text: str) -> str:
    """The same of a text of several lines, which stay lines."""
    return "\n".join(map(escaped, text.split("\n")))
