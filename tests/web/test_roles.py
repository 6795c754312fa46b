"""Which page acts."""

from __future__ import annotations

from o3dls.web.roles import Roles


def test_the_first_page_acts_until_it_has_gone_and_another_asks() -> None:
    roles = Roles()
    roles.enter("a")
    roles.enter("b")
    assert roles.acts("a")
    assert not roles.ask("b")
    roles.leave("a")
    assert roles.acts("a")  # it may be loading anew
    assert roles.free()
    assert roles.ask("b")
    roles.enter("a")
    assert not roles.acts("a")
    assert not roles.ask("a")


def test_a_page_that_is_not_connected_cannot_ask() -> None:
    roles = Roles()
    roles.enter("a")
    roles.leave("a")
    assert not roles.ask("never seen")
