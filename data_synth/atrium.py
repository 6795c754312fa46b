"""A left atrium that moved between imaging and mapping: the prior is what the scanner saw, the points are
what the catheter touched.

Axes as in LPS: x to the patient's left, y to the back, z to the head; mm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from o3dls import Case, Points, Surface, Truth

from . import motion as moves
from . import sampling, shapes
from .meshing import mesh
from .sampling import Mask, Sites
from .shapes import Array, Shape

VEINS = {
    "LSPV": (0.80, 0.36, 0.48),
    "LIPV": (0.76, 0.50, -0.40),
    "RSPV": (-0.80, 0.30, 0.52),
    "RIPV": (-0.75, 0.52, -0.38),
}
APPENDAGE = np.array([0.62, -0.65, 0.44])
MITRAL = np.array([0.34, -0.75, -0.57])
# of the right atrium, beyond the septum
OTHER_MIDDLE, OTHER_AXES = (
    np.array([-43.0, -6.0, -8.0]),
    np.array([18.0, 20.0, 24.0]),
)
SPACING = 1.5
SAME = 0.05  # mm: a wall that both surfaces have, vertices are put onto it within a hundredth
RING_POINTS = 40
OSTIUM_SD = 2.0  # mm, how well an operator marks an ostium in the map


@dataclass(frozen=True, eq=False)
class Anatomy:
    """An atrium at imaging: its parts, its veins' ostia (n, 3) with directions and radii, and the tip of its
    appendage.
    """

    chamber: Shape
    veins: dict[str, Shape]
    appendage: Shape
    ostia: Array
    directions: Array
    radii: Array
    tip: Array

    @property
    def shape(self) -> Shape:
        return shapes.union(
            shapes.union(self.chamber, *self.veins.values(), blend=5.0), self.appendage, blend=4.0
        )

    def without(self, vein: str) -> Anatomy:
        """The same atrium, had this vein never grown."""
        keep = [name != vein for name in self.veins]
        veins = {name: shape for name, shape in self.veins.items() if name != vein}
        return replace(
            self,
            veins=veins,
            ostia=self.ostia[keep],
            directions=self.directions[keep],
            radii=self.radii[keep],
        )


def atrium(
    seed: int = 7,
    *,
    motion: float = 1.0,
    noise: float | None = None,
    points: int = 250,
    outliers: float | None = None,
    unseen: float | None = None,
    lacks: Literal["neither", "prior", "truth"] = "neither",
    beside: int = 0,
) -> Case:
    """The case of a seed. motion: 1 is a typical beat, 0 leaves the similarity only; noise: sd per axis in
    mm.

    outliers: share of the points inside the chamber; unseen: share of the area without points. What is not
    given is drawn: noise from 1 to 2 mm, outliers from 0.05 to 0.10, unseen from 0.15 to 0.25. lacks: which
    surface lacks a vein that the other has; the four take turns with the seed. beside: so many mapping points
    more, of the chamber on the other side of the septum.
    """
    streams = np.random.default_rng((seed, 6871)).spawn(5)
    noise, outliers, unseen = _drawn(
        streams[0], (noise, 1.0, 2.0), (outliers, 0.05, 0.10), (unseen, 0.15, 0.25)
    )
    body = anatomy(streams[1])
    vein = list(VEINS)[seed % len(VEINS)]
    known = body.without(vein) if lacks == "prior" else body
    there = body.without(vein) if lacks == "truth" else body
    imaged = _meshed(known)
    rest = imaged if known is there else _meshed(there)
    beat = heartbeat(streams[2], body, motion)
    truth = rest.with_vertices(beat(rest.vertices))
    prior, ostia = _scanned(streams[3], imaged, known)
    hidden = sampling.patches(rest, bare(streams[0], body, rest), unseen)
    at = visited(streams[4], truth, (~hidden, rings(there, rest)), (points, RING_POINTS))
    measured, inside = mapped(
        streams[4], truth, at, dict(zip(there.veins, beat(there.ostia), strict=True)), noise, outliers
    )
    measured, others = _with_chamber(np.random.default_rng((seed, 7993)), measured, beside, noise)
    held_out = sampling.sites(streams[0], truth, 4000)
    some = np.arange(0, len(prior.vertices), 5)
    some = some[np.abs(there.shape(imaged.vertices[some])) < SAME]
    pairs = prior.vertices[some], beat(imaged.vertices[some])
    drawn = (
        f"seed {seed}, motion {motion:g}, noise {noise:.2f} mm, outliers {outliers:.2f}, unseen {unseen:.2f}"
    )
    said = (
        "" if lacks == "neither" else f"; the {lacks} lacks the {vein}"
    ) + f"; {beside} points of the other atrium" * (beside > 0)
    return Case(
        name=f"atrium_{seed}",
        prior=prior,
        points=measured,
        prior_landmarks=dict(zip(known.veins, ostia, strict=True)),
        frame="LPS",
        notes=f"synthetic left atrium: {drawn}{said}",
        truth=Truth(truth, held_out.xyz, hidden[held_out.face], pairs, np.append(inside, others)),
    )


def roughened(case: Case, noise: float, seed: int) -> Case:
    """The case with noise of this sd per axis (mm) on every vertex of its prior; as it is without any."""
    if noise == 0.0:
        return case
    moved = np.random.default_rng((seed, 31_607)).normal(0.0, noise, case.prior.vertices.shape)
    notes = f"{case.notes}, noise of the prior {noise:g} mm"
    return replace(case, prior=case.prior.with_vertices(case.prior.vertices + moved), notes=notes)


def _meshed(body: Anatomy) -> Surface:
    return mesh(body.shape, (-50, -45, -42), (50, 45, 48), SPACING)


def _drawn(rng: np.random.Generator, *wanted: tuple[float | None, float, float]) -> list[float]:
    """What was asked for, or else a number between the two bounds; the stream advances either way."""
    draws = [rng.uniform(low, high) for _, low, high in wanted]
    return [draw if asked is None else asked for (asked, _, _), draw in zip(wanted, draws, strict=True)]


def anatomy(rng: np.random.Generator) -> Anatomy:
    """A chamber flattened towards the mitral valve, four veins and a bent appendage."""
    axes = np.array([22.5, 17.5, 20.0]) * rng.uniform(0.93, 1.07, 3)
    directions = np.array([_unit(_unit(np.array(v)) + 0.07 * rng.normal(size=3)) for v in VEINS.values()])
    reach = 1.0 / np.linalg.norm(directions / axes, axis=1)  # from the centre to the wall
    radii = rng.uniform(5.0, 7.0, 4)
    ostia = directions * (reach + 2.0)[:, None]
    ends = directions * (reach + rng.uniform(11.0, 17.0, 4))[:, None] + rng.normal(0.0, 1.5, (4, 3))
    tubes = (
        shapes.chain([0.4 * o, o, e], [1.25 * r, r, 0.85 * r], blend=2.0)
        for o, e, r in zip(ostia, ends, radii, strict=True)
    )
    out = _unit(APPENDAGE)
    wall = out / np.linalg.norm(out / axes)
    bends = [
        0.6 * wall,
        wall + 4.0 * out,
        wall + 9.0 * out + [2.0, -1.0, 5.0],
        wall + 12.0 * out + [2.0, -1.0, 11.0],
    ]
    valve = _unit(MITRAL)
    chamber = shapes.intersection(
        shapes.ellipsoid(axes),
        shapes.half_space(valve, 0.82 / float(np.linalg.norm(valve / axes))),
        blend=6.0,
    )
    appendage = shapes.chain(bends, [7.5, 6.5, 5.5, 3.5], blend=2.0)
    return Anatomy(
        chamber, dict(zip(VEINS, tubes, strict=True)), appendage, ostia, directions, radii, bends[-1]
    )


def heartbeat(rng: np.random.Generator, body: Anatomy, amount: float) -> moves.Motion:
    """Motion from imaging to mapping: uneven change of volume by 10 to 25 %, tilt of the upper half, a bulge,
    ostia that shift.
    """
    volume = (1.0 + rng.uniform(0.10, 0.25)) ** rng.choice([-1, 1])
    wall = 20.0 * moves.direction(rng)
    return moves.then(
        moves.strain(volume ** (amount * rng.dirichlet([2.0, 2.0, 2.0]))),
        moves.tilt(
            [1.0, *(0.3 * rng.normal(size=2))],
            amount * rng.choice([-1, 1]) * np.deg2rad(rng.uniform(1.5, 3.5)),
            20.0,
        ),
        moves.drag(
            wall, amount * rng.choice([-1, 1]) * rng.uniform(2.5, 4.5) * _unit(wall), rng.uniform(8.0, 11.0)
        ),
        moves.drag(body.ostia, amount * rng.normal(0.0, 2.0, (4, 3)), 10.0),
    )


def _scanned(rng: np.random.Generator, imaged: Surface, body: Anatomy) -> tuple[Surface, Array]:
    """The prior and its ostia: segmentation error of 0.3 mm, and a pose of the scanner's own, off by 3 to 10
    degrees and mm, and 5 %.
    """
    turned = rng.uniform(0.95, 1.05) * moves.turn(rng, np.deg2rad(rng.uniform(3.0, 10.0)))
    shift = rng.uniform(3.0, 10.0) * moves.direction(rng)
    vertices = moves.wobble(rng, 0.3, 6.0, 3)(imaged.vertices) @ turned.T + shift
    return imaged.with_vertices(vertices), np.round(body.ostia @ turned.T + shift, 3)


def bare(rng: np.random.Generator, body: Anatomy, imaged: Surface) -> Array:
    """Middles (3, 3) of what the catheter misses: the tip of the appendage and two patches of the wall."""
    return np.vstack([body.tip, sampling.sites(rng, imaged, 2).xyz])


def rings(body: Anatomy, imaged: Surface) -> Mask:
    """Faces where veins are isolated: bands of 5 mm about the ostia."""
    to = sampling.centres(imaged)[:, None] - body.ostia
    along = (to * body.directions).sum(axis=2)
    beside = np.linalg.norm(to - along[:, :, None] * body.directions, axis=2)
    return np.asarray(((np.abs(along) < 2.5) & (beside < body.radii + 5.0)).any(axis=1))


def visited(
    rng: np.random.Generator, surface: Surface, where: tuple[Mask, Mask], amounts: tuple[int, int]
) -> tuple[Sites, Sites]:
    """Where the catheter maps and where it ablates. where: faces that it sees, faces that are ablated;
    amounts: number of each.
    """
    (seen, ablated), (n, burns) = where, amounts
    return sampling.sites(rng, surface, n, sampling.clustered(rng, surface, seen)), sampling.sites(
        rng, surface, burns, ablated
    )


def mapped(
    rng: np.random.Generator,
    truth: Surface,
    at: tuple[Sites, Sites],
    ostia: dict[str, Array],
    noise: float,
    share: float = 0.0,
) -> tuple[Points, sampling.Rows]:
    """What the mapping system exports: mapping points, rings of ablation points, marked ostia; and the rows
    that are outliers.

    at: sites that the catheter visited on `truth`; noise: sd per axis in mm; share: of the mapping points
    inside the chamber.
    """
    touched, burnt = at
    n, burns = len(touched.xyz), len(burnt.xyz)
    inside = np.sort(rng.choice(n, round(share * n), replace=False))
    wall = touched.xyz.copy()
    wall[inside] -= rng.uniform(3.0, 12.0, (len(inside), 1)) * truth.face_normals[touched.face[inside]]
    sd = np.repeat([noise, OSTIUM_SD], [n + burns, len(ostia)])
    xyz = np.vstack([wall, burnt.xyz, *ostia.values()])
    # it comes over Bachmann's bundle
    electric = {
        "bipolar": sampling.voltage(truth, sampling.sites(rng, truth, 1).xyz[0]),
        "lat": sampling.activation(truth, truth.vertices[np.argmax(truth.vertices @ [-1.0, -0.5, 1.5])]),
    }
    missing = np.full(len(ostia), np.nan)
    columns = {
        name: np.concatenate([touched.read(truth, v), burnt.read(truth, v), missing])
        for name, v in electric.items()
    }
    return Points(
        np.round(xyz + sd[:, None] * rng.normal(size=xyz.shape), 3),
        np.repeat(["eam", "ablation", "landmark"], [n, burns, len(ostia)]),
        {"name": np.array([""] * (n + burns) + list(ostia))}
        | {name: np.round(v, 2) for name, v in columns.items()},
    ), inside


def _with_chamber(
    rng: np.random.Generator, measured: Points, count: int, noise: float
) -> tuple[Points, sampling.Rows]:
    """The points and, behind them, some of the other atrium's wall; the rows of these."""
    wall = OTHER_MIDDLE + OTHER_AXES * np.array([moves.direction(rng) for _ in range(count)]).reshape(-1, 3)
    xyz = np.round(wall + noise * rng.normal(size=wall.shape), 3)
    columns = {
        name: np.append(v, np.full(count, "" if v.dtype.kind == "U" else np.nan))
        for name, v in measured.columns.items()
    }
    rows = np.arange(len(measured), len(measured) + count)
    return Points(
        np.vstack([measured.xyz, xyz]), np.append(measured.type, np.full(count, "eam")), columns
    ), rows


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))
