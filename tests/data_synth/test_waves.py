"""Waves whose arrival is known by geometry."""

from __future__ import annotations

import numpy as np
from tiny import sphere

from data_synth.waves import map_wave, solve_eikonal, wave
from o3dls.evaluation.measures.numbers import slopes

RADIUS = 25.0
BALL = sphere(RADIUS, 24)


def test_a_wave_on_a_ball_arrives_after_the_great_circle() -> None:
    top = int(BALL.vertices[:, 2].argmax())
    found = solve_eikonal(BALL, np.full(len(BALL.vertices), 0.5), {top: 7.0})
    unit = BALL.vertices / np.linalg.norm(BALL.vertices, axis=1)[:, None]
    true = 7.0 + RADIUS * np.arccos(np.clip(unit @ unit[top], -1.0, 1.0)) / 0.5
    assert np.abs(found - true).max() < 0.01 * true.max()


def test_a_wave_goes_round_what_does_not_conduct() -> None:
    at = BALL.vertices
    top = int(at[:, 2].argmax())
    ring = (np.abs(at[:, 2]) < 3.0) & ~((at[:, 0] > 0.0) & (np.abs(at[:, 1]) < 8.0))  # a gate is left
    speed = np.full(len(at), 0.5)
    free, found = solve_eikonal(BALL, speed, {top: 0.0}), solve_eikonal(BALL, speed, {top: 0.0}, ring)
    behind = (at[:, 2] < -5.0) & (at[:, 0] < -15.0)
    assert np.isnan(found[ring]).any()
    assert (found[behind] > free[behind] + 5.0).all()
    assert np.nanmax(np.abs(found - free)[at[:, 2] > 5.0]) < 0.5


def test_a_reentry_repeats_itself_after_its_cycle() -> None:
    found = wave(BALL, 5, "re-entry")
    assert found.cycle is not None
    there = np.isfinite(found.time)
    phase = np.exp(2j * np.pi * np.where(there, found.time, 0.0) / found.cycle)
    steep = np.hypot(slopes(BALL, phase.real), slopes(BALL, phase.imag))
    speed = 2.0 * np.pi / found.cycle / np.maximum(np.linalg.norm(steep, axis=1), 1e-9)
    inner = there & ~np.isin(np.arange(len(there)), BALL.faces[~there[BALL.faces].all(axis=1)])
    assert np.median((speed / found.speed)[inner]) - 1.0 < 0.03
    mapped = map_wave(BALL, found, 5, 100, clustered=False)
    assert 0.0 <= mapped.time.min() <= mapped.time.max() < found.cycle
