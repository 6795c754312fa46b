"""The engine of a session: an event for every point at once, the same estimate however the points came, and
no point waits for a full fit.
"""

from __future__ import annotations

import logging
import re
from queue import SimpleQueue
from time import monotonic
from typing import Any

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.io.case_reader import read_case
from o3dls.live.background import HELD
from o3dls.live.engine import CLOSED, Engine
from o3dls.live.finish import telling
from o3dls.live.fitting import FullFit, current, full_fit
from o3dls.live.messages import Message, action
from o3dls.live.session import Session, actions_of, empty
from o3dls.live.standing import MOST_HISTORY, Advisor, Standing, expected
from o3dls.resources import demo_case

pytest.importorskip("o3dls.live.display")
FEW = 60


class Idle:
    """A place for full fits where each is made when the test says so."""

    def __init__(self) -> None:
        self.begun: list[Session] = []
        self.running = False
        self.held_until: float | None = None
        self.held = 0  # how often

    @property
    def seconds(self) -> float | None:
        return 0.0 if self.running else None

    def begin(self, session: Session) -> None:
        self.begun.append(session.copy())
        self.running = True

    def taken(self) -> None:
        self.running = False

    def make_way(self) -> None:
        self.held_until, self.held = monotonic() + HELD, self.held + 1

    def go_on(self) -> None:
        self.held_until = None


class Driven:
    """An engine that a test drives, with what it said."""

    def __init__(self, case: Case, actions: list[Message]) -> None:
        self.inbox: SimpleQueue[Any] = SimpleQueue()
        self.said: list[Message] = []
        self.background = Idle()
        session = Session(empty(case))
        for one in actions:
            session.apply(one)
        self.engine = Engine(session, self.said.append, self.inbox, self.background)  # type: ignore[arg-type]
        self.engine.step()

    def do(self, *actions: Message) -> None:
        for one in actions:
            self.inbox.put(("action", action(one)))
        self.settle()

    def fit(self) -> FullFit:
        """End the fit that runs."""
        found = full_fit(self.background.begun[-1])
        self.inbox.put(("fit", found))
        self.settle()
        return found

    def settle(self) -> None:
        self.engine.step()
        while self.engine.unseen or self.engine.changed or self.engine.advising:
            self.engine.step()

    def of(self, kind: str) -> list[Message]:
        return [one for one in self.said if one["event"] == kind]

    @property
    def vertices(self) -> Array:
        assert self.engine.now is not None
        return self.engine.now.estimate.surface.vertices


@pytest.fixture(scope="module")
def case() -> Case:
    return read_case(demo_case())


@pytest.fixture(scope="module")
def actions(case: Case) -> list[Message]:
    """Landmarks first, then points."""
    every = [action(one) for one in actions_of(case)]
    places = [one for one in every if one["do"] != "take"]
    return [*places, *(one for one in every if one["do"] == "take" and one["type"] == "eam")]


@pytest.fixture(scope="module")
def begun(case: Case, actions: list[Message]) -> tuple[Session, FullFit]:
    session = Session(empty(case))
    for one in actions[: 8 + FEW]:
        session.apply(one)
    return session, full_fit(session.copy())


def grown(begun: tuple[Session, FullFit], *more: Message) -> Session:
    session = begun[0].copy()
    for one in map(action, more):
        session.check(one)
        session.apply(one)
    return session


def apart(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b, axis=1).mean())


def test_landmarks_pose_the_prior_before_the_first_fit(case: Case, actions: list[Message]) -> None:
    driven = Driven(case, actions[:8])
    assert [one["posed"] for one in driven.of("scene")] == [True]
    assert "rigid fit of 4 landmarks" in driven.of("state")[-1]["status"]
    driven.do(*(dict(one) for one in actions[8:17]))
    assert not driven.background.begun  # nine points
    driven.do(actions[17])
    assert len(driven.background.begun) == 1
    assert driven.of("state")[-1]["fit"] == "running"
    driven.fit()
    last = driven.of("state")[-1]
    assert last["fitted"] == 10
    assert last["mapped_mm"] < last["unmapped_mm"]
    assert "weak-direction" in {one["code"] for one in last["warnings"]}
    assert len(driven.of("surface")) == 1
    assert driven.of("weights")[-1]["ids"] == list(range(1, 11))


def test_no_point_waits_for_a_full_fit(case: Case, actions: list[Message]) -> None:
    driven = Driven(case, actions[: 8 + FEW])
    driven.fit()
    more = actions[8 + FEW : 8 + FEW + 9]
    for k, one in enumerate(more, 1):
        driven.do(one)
        assert driven.of("surface")[-1]["after"] == FEW + k
        assert driven.of("state")[-1]["fitted"] == FEW + k
    assert driven.background.running  # begun when a tenth more had come, and never ended
    assert "outdated-amplitudes" in {one["code"] for one in driven.of("state")[-1]["warnings"]}
    driven.fit()  # what came meanwhile is put in
    assert driven.of("state")[-1]["fitted"] == FEW + 9
    assert "outdated-amplitudes" not in {one["code"] for one in driven.of("state")[-1]["warnings"]}


def test_points_that_come_together_give_what_they_give_one_by_one(case: Case, actions: list[Message]) -> None:
    one, other = (Driven(case, actions[: 8 + FEW]) for _ in range(2))
    for driven in (one, other):
        driven.fit()
    more = actions[8 + FEW : 8 + FEW + 3]
    one.do(*more)
    for k in more:
        other.do(k)
    assert np.array_equal(one.vertices, other.vertices)


def test_without_a_late_point_the_estimate_is_as_if_it_never_came(
    begun: tuple[Session, FullFit], actions: list[Message]
) -> None:
    first, second = actions[8 + FEW : 8 + FEW + 2]
    fit = begun[1]
    undone = current(fit, grown(begun, first, second, {"do": "undo", "point": FEW + 1}))
    never = current(fit, grown(begun, second))
    assert np.array_equal(undone.estimate.surface.vertices, never.estimate.surface.vertices)
    assert not undone.outdated
    outlier = current(fit, grown(begun, first, second, {"do": "retype", "point": FEW + 1, "type": "outlier"}))
    assert np.array_equal(outlier.estimate.surface.vertices, never.estimate.surface.vertices)


@pytest.mark.parametrize(
    "change",
    [
        {"do": "undo", "point": 5},
        {"do": "retype", "point": 5, "type": "inside"},
        {"do": "label", "point": 5, "values": {"sigma": 0.3}},
        {"do": "landmark", "name": "LSPV", "xyz": [30.0, 0.0, 20.0]},
    ],
)
def test_a_change_of_what_was_fitted_asks_for_a_full_fit(
    begun: tuple[Session, FullFit], actions: list[Message], change: Message
) -> None:
    """Until it is there the estimate knows the points as they were, and the new ones."""
    late = actions[8 + FEW]
    before = current(begun[1], grown(begun, late))
    after = current(begun[1], grown(begun, change, late))
    assert after.outdated
    assert np.array_equal(before.estimate.surface.vertices, after.estimate.surface.vertices)


def test_what_no_fit_sees_asks_for_none(begun: tuple[Session, FullFit]) -> None:
    label = {"do": "label", "point": 5, "values": {"bipolar": 0.3}}
    assert not current(begun[1], grown(begun, label)).outdated


def test_after_an_undo_the_full_fit_is_that_without_the_point(case: Case, actions: list[Message]) -> None:
    driven = Driven(case, actions[: 8 + FEW])
    driven.fit()
    driven.do({"do": "undo", "point": 5})
    assert driven.background.running
    driven.fit()
    never = Session(empty(case))
    for one in [*actions[:12], *actions[13 : 8 + FEW]]:
        never.apply(one)
    found = full_fit(never).estimate
    assert found is not None
    assert apart(driven.vertices, found.surface.vertices) < 1e-9  # rounding
    assert not driven.background.running


def test_a_fit_that_is_refused_is_said_and_waits_for_a_change(case: Case, actions: list[Message]) -> None:
    flat = [{**one, "xyz": [0.01 * k, 0.0, 0.0]} for k, one in enumerate(actions[8:20])]
    driven = Driven(case, [*actions[:8], *flat])
    driven.fit()
    refused = [one for one in driven.of("state")[-1]["warnings"] if one["code"] == "fit-refused"]
    assert "the points span" in refused[0]["text"]
    assert len(driven.background.begun) == 1
    driven.do(actions[30])
    assert len(driven.background.begun) == 2


def test_a_fit_whose_process_is_killed_is_made_again_once(case: Case, actions: list[Message]) -> None:
    driven = Driven(case, actions[: 8 + FEW])
    for begun in (2, 2):
        driven.inbox.put(("fit", FullFit(driven.background.begun[-1], refused="killed", lost=True)))
        driven.settle()
        assert len(driven.background.begun) == begun
    assert [one["text"] for one in driven.of("state")[-1]["warnings"]] == ["the full fit was refused: killed"]
    driven.do(actions[8 + FEW])
    driven.fit()
    assert "fit-refused" not in {one["code"] for one in driven.of("state")[-1]["warnings"]}


def test_the_live_estimate_is_that_of_a_run(begun: tuple[Session, FullFit]) -> None:
    from o3dls.pipeline.file import default_pipeline

    estimate = begun[1].estimate
    assert estimate is not None
    run = default_pipeline().fit(begun[0].case())["deform"]
    assert np.array_equal(estimate.surface.vertices, run.surface.vertices)


def test_three_places_to_touch_next_are_named(begun: tuple[Session, FullFit]) -> None:
    now = current(begun[1], begun[0])
    advised = Advisor(begun[0].prior.prior)(now.case, now.estimate)
    assert len(advised["next"]) == 3
    assert all(one["after"] < one["before"] for one in advised["next"])


def test_the_history_is_thinned_and_ends_with_now(begun: tuple[Session, FullFit]) -> None:
    now = current(begun[1], begun[0])
    standing = Standing(history=[(n, 1.0, 2.0) for n in range(MOST_HISTORY)])
    for n in (MOST_HISTORY, MOST_HISTORY, MOST_HISTORY + 1):
        standing.judge(now.case, now.estimate, n)
    found = standing.record()["history"]
    assert len(found) < MOST_HISTORY
    assert [one[0] for one in found[-2:]] == [MOST_HISTORY, MOST_HISTORY + 1]
    assert found[-1][1:] == list(expected(now.case, now.estimate))


def test_a_fit_makes_way_for_a_point_and_then_goes_on(case: Case, actions: list[Message]) -> None:
    driven = Driven(case, actions[:FEW])
    driven.do(actions[FEW])
    assert driven.background.held == 1
    begin = monotonic()
    while driven.background.held_until is not None and monotonic() < begin + 60.0:
        driven.engine.step()  # sleeps until it is due
    assert driven.background.held_until is None


def test_a_landmark_that_the_others_contradict_is_named(case: Case, actions: list[Message]) -> None:
    """Before any fit: landmarks alone say so."""
    assert not [one for one in Driven(case, actions[:8]).of("state")[-1]["warnings"] if "LIPV" in one["text"]]
    at = next(one for one in actions if one["do"] == "landmark" and one["name"] == "LIPV")["xyz"]
    wrong = {"do": "landmark", "name": "LIPV", "xyz": [at[0] + 20.0, at[1], at[2] + 25.0]}
    driven = Driven(case, [*actions[:8], wrong])
    found = [one for one in driven.of("state")[-1]["warnings"] if one["code"] == "landmark-far"]
    assert found[0]["text"].startswith("LIPV lies ")


def test_a_fit_can_be_asked_for(case: Case, actions: list[Message]) -> None:
    driven = Driven(case, actions[: 8 + FEW])
    driven.fit()
    driven.do(actions[8 + FEW])
    assert driven.of("state")[-1]["behind"] == 1
    assert not driven.background.running
    driven.do({"do": "fit"})
    assert driven.background.running
    driven.fit()
    assert driven.of("state")[-1]["behind"] == 0
    assert not driven.background.running


def test_a_landmark_on_the_prior_stands_in_the_picture_at_once(case: Case, actions: list[Message]) -> None:
    driven = Driven(case, actions[: 8 + FEW])
    driven.fit()
    at = case.prior.vertices[10].tolist()
    driven.do({"do": "prior_landmark", "name": "LAA", "xyz": at})
    (mark,) = [one for one in driven.of("surface")[-1]["landmarks"] if one["name"] == "LAA"]
    gap = np.linalg.norm(driven.vertices - mark["at"], axis=1).argmin()
    assert gap == 10


def test_places_to_touch_next_have_names(begun: tuple[Session, FullFit]) -> None:
    now = current(begun[1], begun[0])
    advised = Advisor(begun[0].prior.prior)(now.case, now.estimate)
    assert all(re.search(r"\d mm .*[LR][SI]PV", one["where"]) for one in advised["next"])


def test_the_end_of_a_session_tells_how_far_it_is() -> None:
    told: list[str] = []
    log = logging.getLogger("o3dls")
    level = log.level
    log.setLevel(logging.INFO)
    with telling(told.append):
        log.info("%s: converged", "icp")
    log.info("later")
    log.setLevel(level)
    assert told == ["begun", "icp: converged"]


def test_the_prior_is_shown_before_anything_else_is_begun() -> None:
    order: list[str] = []

    class Told(Idle):
        def start(self) -> None:
            order.append("process")

    inbox: SimpleQueue[Any] = SimpleQueue()
    inbox.put((CLOSED, None))
    session = Session(empty(read_case(demo_case())))
    engine = Engine(session, lambda event: order.append(event["event"]), inbox, Told())  # type: ignore[arg-type]
    engine.run()
    assert order[:2] == ["scene", "process"]
    assert "advisor" not in vars(engine)
