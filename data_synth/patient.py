"""A patient as in the paper: an MR angiogram in place of a ready prior, and a heart that has filled since it
was imaged.

The angiogram has 45 slices of 0.78125 x 0.78125 x 1.5 mm: contrast in the blood, partial volume, a coil that
sees the front better, noise; the ventricle touches the mitral valve and the aorta passes behind. Axes as in
LPS.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from o3dls import Case, InputError, Surface, Truth

from . import motion as moves
from . import sampling, shapes
from .atrium import MITRAL, SPACING, VEINS, Anatomy, anatomy, bare, mapped, rings, visited
from .meshing import mesh
from .sampling import Sites
from .shapes import Array, Shape

SLICES, PIXELS = 45, 136
VOXEL = np.array([0.78125, 0.78125, 1.5])  # x, y, z
BLOOD, TISSUE, NOISE = 1.0, 0.35, 0.06
BLUR = 1.2  # mm over which a wall is spread by partial volume and the scanner's point spread
NOISE_OF_POINTS = 1.5
BURNS = 120  # ablation points: thirty about each vein
BULGES = (8.0, 9.0, -8.0)  # mm: two places bulge out, one goes in
RIPPLE = (0.6, 6.0)  # mm, sd per axis and length: the wall is nowhere exactly where a smooth motion takes it
MISSED = (4.2, 2.72)  # mm: see `filled`


@dataclass(frozen=True, eq=False)
class Patient:
    """What there is of a patient: the case, its prior as the anatomy truly was, and the angiogram with a
    place inside the atrium.

    scan (nz, ny, nx); affine (4, 4) takes indices (x, y, z) to mm of the scanner, the prior's frame.
    """

    case: Case
    scan: NDArray[np.float32]
    affine: Array
    inside: Array


def patient(seed: int = 7, *, missed: tuple[float, float] = MISSED, points: int = 250) -> Patient:
    """The patient of a seed. missed: how far mapping and ablation sites lie from the wall in its best rigid
    pose, mm, see `filled`.
    """
    streams = np.random.default_rng((seed, 9137)).spawn(5)
    body = anatomy(streams[1])
    imaged = mesh(body.shape, (-50, -45, -42), (50, 45, 48), SPACING)
    hidden = sampling.patches(imaged, bare(streams[0], body, imaged), 0.2)
    at = visited(streams[4], imaged, (~hidden, rings(body, imaged)), (points, BURNS))
    beat = filled(streams[2], body, at, missed)
    truth = imaged.with_vertices(beat(imaged.vertices))
    ostia = dict(zip(VEINS, beat(body.ostia), strict=True))
    measured, _ = mapped(streams[4], truth, (at[0].on(truth), at[1].on(truth)), ostia, NOISE_OF_POINTS)
    held_out = sampling.sites(streams[0], truth, 4000)
    turned = moves.turn(streams[3], np.deg2rad(12.0))
    shift = 15.0 * moves.direction(streams[3])
    case = Case(
        name=f"patient_{seed}",
        prior=imaged.with_vertices((imaged.vertices - shift) @ turned),
        points=measured,
        prior_landmarks=dict(zip(VEINS, (body.ostia - shift) @ turned, strict=True)),
        frame="LPS",
        notes=(
            f"synthetic patient: seed {seed}, a rigid pose misses {missed[0]:g} and {missed[1]:g} mm, "
            f"noise {NOISE_OF_POINTS} mm"
        ),
        truth=Truth(truth, held_out.xyz, hidden[held_out.face]),
    )
    scanned = _in_scanner(blood(body), turned, shift)
    return Patient(case, *angiogram(streams[3], scanned, case.prior), -shift @ turned)


def filled(
    rng: np.random.Generator, body: Anatomy, at: tuple[Sites, Sites], missed: tuple[float, float]
) -> moves.Motion:
    """Motion from imaging to mapping: the body fills unevenly, turns, bulges, ripples; about the ostia, less
    or more of it.

    missed: how far (mean, mm) mapping and ablation sites shall lie from the imaged wall in its best rigid
    pose. The size of the motion follows from the first, its share about the ostia from the second: from the
    truth without noise, not from what a method makes of it. A motion that no share brings there is drawn
    again.
    """
    for _ in range(20):
        beat = _drawn(rng, body, at[0])
        amount = 1.5
        held = 0.0
        for _ in range(16):
            wall, rings = (
                found / wanted
                for found, wanted in zip(_missed(body.shape, beat(amount, held), at), missed, strict=True)
            )
            if max(abs(wall - 1.0), abs(rings - 1.0)) < 0.02:
                return beat(amount, held)
            amount = amount / wall
            held = float(np.clip(held + 0.6 * (rings - wall), -0.9, 0.9))
    raise InputError(f"patient: missed = {missed}: no motion found that a rigid pose misses by so much")


def _drawn(
    rng: np.random.Generator, body: Anatomy, mapped_at: Sites
) -> Callable[[float, float], moves.Motion]:
    """A family of motions by size and by share that is held rigid about the ostia."""
    strain = rng.uniform(0.06, 0.10, 3)
    tilt = rng.choice([-1, 1]) * np.deg2rad(4.0)
    axis = [1.0, *(0.3 * rng.normal(size=2))]
    ostia = rng.normal(0.0, 0.6, (4, 3))
    out = _apart(rng, len(BULGES), body.directions)
    ripple = moves.wobble(rng, *RIPPLE, 3)

    def beat(amount: float, held: float) -> moves.Motion:
        bulges = moves.drag(18.0 * out, amount * out * np.array(BULGES)[:, None], 21.0)
        free = moves.then(moves.strain(1.0 + amount * strain), moves.tilt(axis, amount * tilt, 20.0), bulges)
        rigid = moves.nearest_rigid(mapped_at.xyz, free(mapped_at.xyz))
        return moves.then(
            moves.blend(free, rigid, held, body.ostia, 18.0), moves.drag(body.ostia, ostia, 15.0), ripple
        )

    return beat


def _apart(rng: np.random.Generator, count: int, veins: Array) -> Array:
    """Directions (count, 3) away from the veins and from each other; where the first leave no place for the
    last, from anew.
    """
    found: list[Array] = []
    while len(found) < count:
        found = []
        for _ in range(1000):
            one = moves.direction(rng)
            if (
                len(found) < count
                and (veins @ one).max() < 0.45
                and all(one @ other < 0.5 for other in found)
            ):
                found.append(one)
    return np.array(found)


def _missed(imaged: Shape, beat: moves.Motion, at: tuple[Sites, Sites]) -> list[float]:
    """Mean distance of the moved sites from the wall as imaged, in the rigid pose in which that of the first
    is smallest (rms).
    """
    near = moves.nearest_rigid(beat(at[0].xyz), at[0].xyz)
    moved = [near(beat(sites.xyz)) for sites in at]

    def posed(p: Array, pose: Array) -> Array:
        # 20 mm: turns and shifts of one size
        return np.asarray(Rotation.from_rotvec(pose[:3] / 20.0).apply(p) + pose[3:])

    def heights(pose: Array) -> Array:
        return np.asarray(imaged(posed(moved[0], pose)))

    best = least_squares(heights, np.zeros(6), max_nfev=15).x
    return [float(np.abs(imaged(posed(p, best))).mean()) for p in moved]


def blood(body: Anatomy) -> Shape:
    """All blood about the atrium: the ventricle below its valve, which is thinner than a voxel, and the aorta
    behind.
    """
    valve = MITRAL / np.linalg.norm(MITRAL)
    to_valve = _reach(body.shape, valve)
    ventricle = shapes.ball((to_valve + 0.8 + 21.0) * valve, 21.0)
    behind = _reach(body.shape, np.array([0.3, 1.0, -0.1]) / np.linalg.norm([0.3, 1.0, -0.1])) + 12.0
    aorta = shapes.round_cone((6.0, behind, -60.0), (6.0, behind, 60.0), 9.0, 9.01)
    return shapes.union(body.shape, ventricle, aorta)


def angiogram(rng: np.random.Generator, scene: Shape, prior: Surface) -> tuple[NDArray[np.float32], Array]:
    """Grey values (nz, ny, nx) about the middle of a surface, and the affine of the indices (x, y, z)."""
    shape = np.array([PIXELS, PIXELS, SLICES])
    middle = (prior.vertices.min(axis=0) + prior.vertices.max(axis=0)) / 2.0
    affine = np.diag([*VOXEL, 1.0])
    affine[:3, 3] = middle - VOXEL * (shape - 1) / 2.0
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape[::-1]), indexing="ij"), axis=-1)[
        ..., ::-1
    ].reshape(-1, 3)
    at = index * VOXEL + affine[:3, 3]
    share = 1.0 / (1.0 + np.exp(np.clip(4.0 * scene(at) / BLUR, -50.0, 50.0)))
    coil = 1.0 - 0.002 * (at[:, 1] - middle[1])
    clean = coil * (TISSUE + (BLOOD - TISSUE) * share)
    # magnitudes: Rice's distribution
    noisy = np.hypot(clean + NOISE * rng.normal(size=len(at)), NOISE * rng.normal(size=len(at)))
    return noisy.reshape(shape[::-1]).astype(np.float32), affine


def _reach(shape: Shape, direction: Array) -> float:
    """Way from the origin to the wall along a unit vector."""
    steps = np.arange(5.0, 60.0, 0.05)
    return float(steps[np.argmax(shape(steps[:, None] * direction) > 0.0)])


def _in_scanner(shape: Shape, turned: Array, shift: Array) -> Shape:
    """The shape in the scanner's frame."""
    return lambda p: shape(p @ turned.T + shift)
