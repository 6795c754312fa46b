"""What travels in a live session: what is no action is refused in words."""

from __future__ import annotations

from typing import Any

import pytest

from o3dls.errors import InputError
from o3dls.live.messages import action

TURNED = [[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]


@pytest.mark.parametrize(
    ("given", "found"),
    [
        (
            {"do": "take", "xyz": [1, 2, 3]},
            {"do": "take", "type": "eam", "values": {}, "xyz": [1.0, 2.0, 3.0]},
        ),
        (
            {"do": "take", "xyz": [1, 2, 3], "type": "inside", "values": {"bipolar": 1, "tag": "scar"}},
            {
                "do": "take",
                "type": "inside",
                "values": {"bipolar": 1.0, "tag": "scar"},
                "xyz": [1.0, 2.0, 3.0],
            },
        ),
        ({"do": "undo"}, {"do": "undo"}),
        ({"do": "undo", "point": 3}, {"do": "undo", "point": 3}),
        (
            {"do": "landmark", "name": " LSPV ", "next": True},
            {"do": "landmark", "name": "LSPV", "next": True},
        ),
        ({"do": "pose", "matrix": TURNED}, {"do": "pose", "matrix": TURNED}),
        ({"do": "end"}, {"do": "end"}),
    ],
)
def test_an_action_is_read(given: dict[str, Any], found: dict[str, Any]) -> None:
    assert action(given) == found


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ("take", 'a key "do"'),
        ({"do": "tale"}, "did you mean 'take'"),
        ({"do": "take"}, "'xyz' is missing"),
        ({"do": "take", "xyz": [1, 2]}, "three numbers"),
        ({"do": "take", "xyz": [1, 2, float("nan")]}, "finite"),
        ({"do": "take", "xyz": [1, 2, 1e6]}, "within 100000"),
        ({"do": "take", "xyz": [1, 2, "3"]}, "finite"),
        ({"do": "take", "xyz": [10**400, 1, 2]}, "finite"),
        ({"do": "pose", "matrix": [[10**400, 0, 0, 0]] * 4}, "finite"),
        ({"do": "take", "xyz": [1, 2, 3], "values": {"own": 10**400}}, "finite"),
        ({"do": "take", "xyz": [1, 2, 3], "values": {"own": "\ud800"}}, "control character"),
        ({"do": "take", "xyz": [1, 2, 3], "values": {"\udfff": 1.0}}, "names no value"),
        ({"do": "landmark", "name": "\ud800", "next": True}, "must be a name"),
        ({"do": "prior_landmark", "name": "a\udc80", "xyz": [1, 2, 3]}, "must be a name"),
        ({"do": "take", "xyz": [1, 2, 3], "typ": "eam"}, "did you mean 'type'"),
        ({"do": "take", "xyz": [1, 2, 3], "type": "aem"}, "did you mean 'eam'"),
        ({"do": "take", "xyz": [1, 2, 3], "values": {"sigma": 0.0}}, "must be above 0"),
        ({"do": "take", "xyz": [1, 2, 3], "values": {"bipolar": -10000}}, "leave it out where there is none"),
        ({"do": "label", "point": 1, "values": {"LAT_ms": -9999.0}}, r"within \[-5000, 5000\] ms"),
        ({"do": "take", "xyz": [1, 2, 3], "values": {"x": 0.0}}, "names no value"),
        ({"do": "take", "xyz": [1, 2, 3], "values": {"bipolar": float("inf")}}, "finite number"),
        ({"do": "label", "point": 1, "values": {"name": "a\nb"}}, "line break"),
        ({"do": "retype", "point": 0, "type": "eam"}, "must be the number of a point"),
        ({"do": "undo", "point": True}, "must be the number of a point"),
        ({"do": "landmark", "name": "LSPV"}, 'either "xyz" or "next"'),
        ({"do": "landmark", "name": "LSPV", "next": True, "xyz": [1, 2, 3]}, 'either "xyz" or "next"'),
        ({"do": "landmark", "name": " ", "next": True}, "must be a name"),
        ({"do": "pose", "matrix": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}, "is no pose"),
    ],
)
def test_what_is_no_action_is_refused_in_words(given: object, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        action(given)
