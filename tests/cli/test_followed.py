"""Each sentence of the program that advises something is followed by a test, which does what it says."""

from __future__ import annotations

import pytest

from tests.cli.followed import FOLLOWED, NO_ADVICE, ROOT, advises, asks_for_nothing, followed_by, strings

SENTENCES = [(name, text) for name, _, text in strings() if advises(text)]


def test_sentences_are_found_by_what_they_ask_for() -> None:
    assert len(SENTENCES) > 150
    for text in (
        "{}: {} values; say --label",
        "say fill_slices=True",
        "say cap = true in case.toml",
        "is damaged; run it again",
        "not there; pip install {}",
        "write it: o3dls convert",
        "states cm; omit that",
        'name the stage, such as use = "{}"',
    ):
        assert advises(text), text
    for text in ("{}: no such file", "an earlier run in the same folder", "--fill-slices", "scale = {}"):
        assert not advises(text), text


def test_every_sentence_that_advises_is_followed_by_a_test() -> None:
    for name, text in SENTENCES:
        followed = bool(followed_by(text))
        assert followed != asks_for_nothing(text), f"{name}: followed {followed}, must be once: {text}"


@pytest.mark.parametrize("words", FOLLOWED)
def test_what_is_followed_is_said_and_by_a_test_that_is_there(words: str) -> None:
    tests = [followed_by(text) for _, text in SENTENCES if words in text]
    assert any(FOLLOWED[words] in one for one in tests), f"no sentence says: {words}"
    file, _, test = FOLLOWED[words].partition("::")
    assert f"def {test}(" in (ROOT / "tests" / file).read_text(encoding="utf-8"), words


@pytest.mark.parametrize("words", sorted(NO_ADVICE))
def test_what_asks_for_nothing_is_said(words: str) -> None:
    begun = words.removesuffix("...")
    assert any(text == begun or (begun != words and text.startswith(begun)) for _, text in SENTENCES), words
