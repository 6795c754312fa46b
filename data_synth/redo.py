"""Two maps of one heart, as before and after an ablation: each with its own motion, points, noise and
catheter, and perhaps with a new scar in the second.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from o3dls import Case, Points, Surface, Truth

from . import sampling, wall
from .family import LANDMARKS, beaten, marked, named, ways_of
from .mapping import HELD_OUT, MARKED_SD, UNSEEN, Mapping, case_of
from .sampling import Mask
from .shapes import Array

VOLTAGE, CHANGED = "bipolar_true", "changed"  # fields of the true walls: mV, and 1 where there is a new scar
HEALTHY = 2.2  # mV, the median
SMOOTH = (15.0, 0.35)  # mm over which the voltage varies, sd of its logarithm
PATCHY = (4.0, 0.25)
OLD_SCARS, OLD_RADIUS, OLD_LOW = 2, (4.0, 8.0), (0.15, 0.4)  # mm, mV
NEW_LOW = (0.1, 0.4)  # mV
HEALTHY_SHARE, HEALTHY_FROM = 0.9, 1.0  # mV: so much of a new scar's place was above this
WOBBLE, RIM = (6.0, 0.15), 0.5  # of its border: mm and share of the radius; mm
GAIN = (0.8, 1.25)  # of the second catheter over the first
VALUE_NOISE = (0.2, 0.03)  # sd of a value's logarithm, and mV
HIDDEN_DRAWS = 50
FAMILIES = ("flow", "arap", "regions", "piston")


@dataclass(frozen=True, eq=False)
class Redo:
    """A redo has the cases of both maps, and the gain of the second catheter over the first. Their true walls
    have the fields `bipolar_true` (mV, as the own catheter shows it) and `changed`.
    """

    before: Case
    after: Case
    gain: float


def redo(prior: Surface, seed: int, area: float, how: Mapping | None = None) -> Redo:
    """Two maps of a heart on one prior. area: of the new scar in cm², 0 for none.

    The voltage has a smooth part, a patchy one and two old scars. At each map the heart has a motion of its
    own, of another family, and another pose; four far ends are marked.
    """
    values, lesion, *beats = np.random.default_rng((seed, 62_903)).spawn(4)
    first = _voltage(values, prior)
    scar = _new_scar(lesion, prior, first, 100.0 * area) if area else np.zeros(len(first))
    low = np.minimum(lesion.uniform(*NEW_LOW) * np.exp(rough_field(lesion, prior, *PATCHY)), first)
    gain = float(np.exp(lesion.uniform(*np.log(GAIN))))
    second = gain * first ** (1.0 - scar) * low**scar
    fields = [{VOLTAGE: v, CHANGED: (scar > 0.5).astype(np.float64)} for v in (first, second)]
    walls = [
        beaten(prior, FAMILIES[(seed + k) % len(FAMILIES)], 1.0, *beat.spawn(2)).wall
        for k, beat in enumerate(beats)
    ]
    before, after = (
        map_wall(beat, prior, replace(moved, fields=own), how or Mapping(points=500), f"redo_{seed}_{name}")
        for beat, moved, own, name in zip(beats, walls, fields, ("before", "after"), strict=True)
    )
    return Redo(before, after, gain)


def map_wall(
    rng: np.random.Generator,
    prior: Surface,
    truth: Surface,
    how: Mapping,
    name: str,
    value_noise: tuple[float, float] = VALUE_NOISE,
) -> Case:
    """The map of a wall with its voltages (field `bipolar_true`), as `mapped` takes it, without points
    inside. Fields of the wall that the prior has too are columns of the points, as they are at the true
    sites. value_noise: sd of a value's logarithm, and mV.
    """
    hidden = _hide(rng, truth, UNSEEN if how.clustered else 0.0)
    density = sampling.clustered(rng, truth, ~hidden) if how.clustered else 1.0 * ~hidden
    at = sampling.sites(rng, truth, how.points, density)
    value = np.exp(at.read(truth, np.log(truth.fields[VOLTAGE])))  # half way over a border is half its ratio
    spread, floor = value_noise
    value = value * np.exp(spread * rng.normal(size=how.points)) + floor * rng.normal(size=how.points)
    places = wall.far_places(prior, len(LANDMARKS))
    marks = np.array(list(named(truth, places).values()))
    sd = how.noise or 1.0
    xyz = np.vstack([
        at.xyz + sd * rng.normal(size=at.xyz.shape),
        marks + MARKED_SD * rng.normal(size=marks.shape),
    ])  # fmt: skip
    none = np.full(len(marks), np.nan)
    columns = {
        "name": np.array([""] * how.points + list(LANDMARKS)),
        "bipolar": np.append(np.maximum(value, 0.01), none).round(3),
    }
    for field in truth.fields.keys() & prior.fields.keys():
        columns[f"{field}_true"] = np.append(at.read(truth, truth.fields[field]), none).round(5)
    points = Points(xyz.round(3), np.repeat(["eam", "landmark"], [how.points, len(marks)]), columns)
    test = sampling.sites(rng, truth, HELD_OUT)
    known = Truth(truth, test.xyz, hidden[test.face], ways_of(prior, truth), np.zeros(0, dtype=np.int64))
    return case_of(name, prior, (points, known), marked(prior, places), f"{name}: {how}")


def _hide(rng: np.random.Generator, truth: Surface, share: float) -> Mask:
    """Faces (m,) that no catheter visits: three patches, which leave the new scar where they can."""
    scar = truth.fields[CHANGED][truth.faces].max(axis=1)
    for _ in range(HIDDEN_DRAWS):
        found = sampling.patches(truth, sampling.sites(rng, truth, 3).xyz, share)
        if not scar[found].any():
            break
    return found


def _voltage(rng: np.random.Generator, surface: Surface) -> Array:
    """A field of voltages (n,) in mV: smooth, patchy, with old scars."""
    found = np.log(HEALTHY) + rough_field(rng, surface, *SMOOTH) + rough_field(rng, surface, *PATCHY)
    for middle in rng.choice(wall.far_places(surface, 8), OLD_SCARS, replace=False):
        away = wall.ways(surface, np.array([middle]))[0]
        found += inside_of(away - rng.uniform(*OLD_RADIUS), 1.0) * (np.log(rng.uniform(*OLD_LOW)) - found)
    return np.asarray(np.exp(found))


def _new_scar(rng: np.random.Generator, surface: Surface, before: Array, area: float) -> Array:
    """A patch (n,) in [0, 1] of an area in mm² with an uneven border, where the wall was healthy."""
    weight = wall.vertex_areas(surface)
    wobble = np.maximum(1.0 + rough_field(rng, surface, *WOBBLE), 0.5)
    for middle in rng.permutation(len(before)):
        away = wall.ways(surface, np.array([middle]))[0] / wobble
        order = np.argsort(away)
        taken = order[: int(np.searchsorted(np.cumsum(weight[order]), area))]
        if weight[taken] @ (before[taken] > HEALTHY_FROM) > HEALTHY_SHARE * weight[taken].sum():
            break
    return inside_of(away - away[taken].max(), RIM)


def inside_of(beyond: Array, rim: float) -> Array:
    """1 inside a border, 0 outside, by how far (n,) in mm a place lies beyond it."""
    return np.asarray(1.0 / (1.0 + np.exp(np.clip(beyond / rim, -50.0, 50.0))))


def rough_field(rng: np.random.Generator, surface: Surface, length: float, sd: float) -> Array:
    """A random field (n,) that varies over a length."""
    found = wall.smoothed(surface, rng.normal(size=(len(surface.vertices), 1)), length)
    found = wall.smoothed(surface, found, length)[:, 0]
    return np.asarray(sd * (found - found.mean()) / found.std())
