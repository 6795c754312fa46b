"""Names that mean one place are partners; all that might not are left alone."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from o3dls.registration.landmark_names import PLACES, alone, doubts, is_known, partners

SAME = (
    (
        "LSPV",
        "lspv",
        "left superior pulmonary vein",
        "Left Upper PV",
        "L sup PV",
        "left_upper_pulmonary_vein",
        "Pulmonary vein, left superior",
        "ostium of the left superior pulmonary vein",
        "LSPV OS",
    ),
    (
        "LIPV",
        "LLPV",
        "linke untere Lungenvene",
        "veine pulmonaire inférieure gauche",
        "left lower pulmonary vein",
        "L. inf. PV",
    ),
    ("RSPV", "right upper PV", "rechter oberer PV", "vena pulmonar superior derecha"),
    ("RIPV", "RLPV", "right inferior pulmonary vein orifice"),
    ("LCPV", "left common pulmonary vein", "Left common trunk"),
    ("RMPV", "right middle PV"),
    ("MA", "MV", "Mitral Annulus", "mitral valve"),
    ("LAA", "left atrial appendage", "LA appendage"),
    ("CS OS", "coronary sinus ostium"),
    ("CS", "coronary sinus"),
    ("Roof", "roof "),
    ("roof 1", "Roof_1"),
    ("septum",),
)


@pytest.mark.parametrize("names", SAME, ids=lambda names: names[0])
def test_names_of_one_place_are_partners_of_each_other(names: tuple[str, ...]) -> None:
    for one, other in itertools.product(names, names):
        assert partners([one], [other]) == {0: 0}


def test_names_of_different_places_never_are() -> None:
    for first, second in itertools.permutations(SAME, 2):
        for one, other in itertools.product(first, second):
            assert partners([one], [other]) == {}
    for one, other in (
        ("LAA", "LAA ostium"),
        ("A+", "A-"),
        ("?", "!"),
        ("left vein", "LSPV"),
        ("PV", "LSPV"),
    ):
        assert partners([one], [other]) == {}


def test_a_name_that_two_might_mean_is_left_alone() -> None:
    assert partners(["MV"], ["MA", "mitral valve annulus"]) == {}
    assert partners(["MA", "MV"], ["mitral valve"]) == {}
    assert partners(["MA", "MV"], ["MV"]) == {1: 0}  # the same name first
    assert partners(["LSPV", "LSPV OS"], ["left upper PV", "left upper PV ostium"]) == {0: 0, 1: 1}
    assert partners(["LSPV OS", "LSPV"], ["L sup PV"]) == {1: 0}
    assert alone(["LSPV", "MA"], ["left superior PV", "LAA"]) == ["MA"]


def test_partners_do_not_depend_on_sides_or_order() -> None:
    rng = np.random.default_rng(60_917)
    names = [name for same in SAME for name in same]
    for _ in range(50):
        first, second = (rng.choice(names, 6, replace=False).tolist() for _ in range(2))
        found = partners(first, second)
        assert {j: i for i, j in partners(second, first).items()} == found
        turned = partners(first[::-1], second)
        assert {len(first) - 1 - i: j for i, j in turned.items()} == found


def test_the_table_names_no_place_twice() -> None:
    names = [name for place, more in PLACES.items() for name in (place, *more)]
    for one, other in itertools.combinations(names, 2):
        same = any({one, other} <= {place, *more} for place, more in PLACES.items())
        assert (partners([one], [other]) == {0: 0}) == same
    assert is_known("LSPV OS")
    assert is_known("LAA")
    assert not is_known("HIS")


PRIOR = ["LSPV", "LIPV", "RSPV", "RIPV", "LAA"]


@pytest.mark.parametrize(
    ("names", "meant"),
    [
        (["LUPV", "LLPV", "RUPV", "RLPV"], "LSPV LIPV RSPV RIPV"),  # upper, lower
        (["LOPV", "LUPV", "ROPV", "RUPV"], "LSPV LIPV RSPV RIPV"),  # obere, untere
        (["LBPV", "LOPV", "RBPV", "ROPV"], "LSPV LIPV RSPV RIPV"),  # boven, onder
        (["lupv", "LIPV", "RSPV", "R_UPV"], "LSPV LIPV RSPV RIPV"),  # the other one has its name
        (["LUPV", "linke obere Pulmonalvene", "RUPV os", "LAA"], "LIPV LSPV RIPV LAA"),
        (["LUPV", "right lower PV", "LAA"], "LSPV RIPV LAA"),
        (["LUPV", "RUPV", "LAA"], "- - LAA"),
        (["LOPV", "LAA"], "- LAA"),
        (["RBPV"], "-"),
    ],
)
def test_a_letter_means_what_the_names_beside_it_say(names: list[str], meant: str) -> None:
    found = partners(names, PRIOR)
    assert [PRIOR[found[i]] if i in found else "-" for i in range(len(names))] == meant.split()
    assert bool(doubts(names, PRIOR)) == ("-" in meant)
    for name in np.array(names)[np.array(meant.split()) == "-"]:
        assert name in doubts(names, PRIOR)
        assert is_known(name)


def test_names_in_doubt_pair_with_themselves_unless_two_languages_use_them() -> None:
    assert partners(["LUPV", "RUPV"], ["RUPV", "LUPV"]) == {0: 1, 1: 0}
    assert doubts(["LUPV", "RUPV"], ["RUPV", "LUPV"]) == ""
    assert partners(["LUPV", "LAA"], ["LUPV", "LLPV"]) == {0: 0}
    german, english = ["LOPV", "LUPV"], ["LUPV", "LLPV"]
    assert partners(german, english) == {0: 0, 1: 1}
    assert partners(german, ["LUPV", "LOPV"]) == {0: 1, 1: 0}
