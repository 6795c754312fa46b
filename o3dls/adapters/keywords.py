"""Errors of readers, which speak of files and options, said by keyword arguments to who holds objects."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import InputError

FILES = r"close it with `o3dls convert --cap`, or say cap = true in case\.toml"
WORDS = (
    (re.compile(FILES), "say cap=True to close it"),
    (re.compile(r"--(frame|units) (LPS|RAS|unknown|mm|cm|m|um|in|px)\b"), r"\1='\2'"),
    (re.compile(r"--form (sform|qform)\b"), r"form='\1'"),
    (re.compile(r"--fill-slices\b"), "fill_slices=True"),
    (re.compile("--box" + r" (-?[\d.]+)" * 6), r"box=(\1, \2, \3, \4, \5, \6)"),
    (re.compile(r"--(label|part|layer|box|form|frame|units|cap)\b"), r"\1="),
)


@contextmanager
def keyword_errors() -> Iterator[None]:
    """Raise the errors of what is done within with the names of keyword arguments for those of options."""
    try:
        yield
    except InputError as error:
        error.args = (in_keywords(str(error)),)
        raise


def in_keywords(sentence: str) -> str:
    """Return a sentence with keyword arguments where it names options of the command line."""
    for options, words in WORDS:
        sentence = options.sub(words, sentence)
    return sentence
