"""A patient as in the paper: an MR angiogram in place of a ready prior, and a heart that has filled since it was imaged.

The angiogram has 45 slices of 0.78125 x 0.78125 x 1.5 mm: contrast in the blood, partial volume, a coil that sees the front better, noise;
the ventricle touches the mitral valve and the aorta passes behind. Axes as in LPS.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3dls import Case, Surface, Truth

from . import motion as moves
from . import sampling, shapes
from .atrium import MITRAL, SPACING, VEINS, Anatomy, anatomy, bare, mapped, rings
from .meshing import mesh
from .shapes import Array, Shape

SLICES, PIXELS = 45, 136
VOXEL = np.array([0.78125, 0.78125, 1.5])  # x, y, z
BLOOD, TISSUE, NOISE = 1.0, 0.35, 0.06
BLUR = 1.2  # mm over which a wall is spread by partial volume and the scanner's point spread
NOISE_OF_POINTS = 1.5
BULGES = 3


@dataclass(frozen=True, eq=False)
class Patient:
    """What there is of a patient: the case, its prior as the anatomy truly was, and the angiogram with a place inside the atrium.

    scan (nz, ny, nx); affine (4, 4) takes indices (x, y, z) to mm of the scanner, the prior's frame.
    """

    case: Case
    scan: NDArray[np.float32]
    affine: Array
    inside: Array


def patient(seed: int = 7, *, moved: float = 4.5, points: int = 250) -> Patient:
    """The patient of a seed. moved: mean way of the wall (mm) that no rigid motion explains; 4.5 gives rigid ICP the paper's errors."""
    streams = np.random.default_rng((seed, 9137)).spawn(5)
    body = anatomy(streams[1])
    imaged = mesh(body.shape, (-50, -45, -42), (50, 45, 48), SPACING)
    beat = filled(streams[2], body, imaged, moved)
    truth = imaged.with_vertices(beat(imaged.vertices))
    hidden = sampling.patches(imaged, bare(streams[0], body, imaged), 0.2)
    seen = (~hidden, rings(body, imaged))
    measured, _ = mapped(streams[4], truth, seen, beat(body.ostia), (points, NOISE_OF_POINTS, 0.0))
    held_out = sampling.sites(streams[0], truth, 4000)
    turned, shift = moves.turn(streams[3], np.deg2rad(12.0)), 15.0 * moves.direction(streams[3])
    case = Case(
        name=f"patient_{seed}",
        prior=imaged.with_vertices((imaged.vertices - shift) @ turned),
        points=measured,
        prior_landmarks=dict(zip(VEINS, (body.ostia - shift) @ turned, strict=True)),
        frame="LPS",
        notes=f"synthetic patient: seed {seed}, wall moved {moved:g} mm, noise {NOISE_OF_POINTS} mm",
        truth=Truth(truth, held_out.xyz, hidden[held_out.face]),
    )
    scanned = _in_scanner(blood(body), turned, shift)
    return Patient(case, *angiogram(streams[3], scanned, case.prior), -shift @ turned)


def filled(rng: np.random.Generator, body: Anatomy, imaged: Surface, moved: float) -> moves.Motion:
    """Motion from imaging to mapping: the body fills unevenly, its front and roof bulge, the ostia are held by their veins.

    moved: mean way of the wall along its normal (mm) that no rigid motion explains.
    """
    strain, tilt = rng.uniform(0.04, 0.16, 3), rng.choice([-1, 1]) * np.deg2rad(4.0)
    axis, ostia = [1.0, *(0.3 * rng.normal(size=2))], rng.normal(0.0, 1.2, (4, 3))
    out = _apart(rng, BULGES, body.directions)
    bulges = out * (rng.choice([1, 1, -1], BULGES) * rng.uniform(6.0, 10.0, BULGES))[:, None]

    def beat(amount: float) -> moves.Motion:
        return moves.then(
            moves.strain(1.0 + amount * strain),
            moves.tilt(axis, amount * tilt, 20.0),
            moves.drag(18.0 * out, amount * bulges, 18.0),
            moves.drag(body.ostia, amount * ostia, 10.0),
        )

    amount = 1.0
    for _ in range(3):
        amount *= moved / _shape_change(imaged, beat(amount)(imaged.vertices))
    return beat(amount)


def _apart(rng: np.random.Generator, count: int, veins: Array) -> Array:
    """Directions (count, 3) away from the veins and from each other."""
    found: list[Array] = []
    for _ in range(1000):
        one = moves.direction(rng)
        if len(found) < count and (veins @ one).max() < 0.45 and all(one @ other < 0.5 for other in found):
            found.append(one)
    return np.array(found)


def _shape_change(surface: Surface, positions: Array) -> float:
    """Mean way of the vertices along their normals once the best rigid motion is taken out."""
    a, b = surface.vertices - surface.vertices.mean(axis=0), positions - positions.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    rest = b - a @ (u @ vt).T
    return float(np.abs((rest * surface.vertex_normals).sum(axis=1)).mean())


def blood(body: Anatomy) -> Shape:
    """All blood about the atrium: the ventricle below its valve, which is thinner than a voxel, and the aorta behind."""
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
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape[::-1]), indexing="ij"), axis=-1)[..., ::-1].reshape(-1, 3)
    at = index * VOXEL + affine[:3, 3]
    share = 1.0 / (1.0 + np.exp(np.clip(4.0 * scene(at) / BLUR, -50.0, 50.0)))
    coil = 1.0 - 0.002 * (at[:, 1] - middle[1])
    clean = coil * (TISSUE + (BLOOD - TISSUE) * share)
    noisy = np.hypot(clean + NOISE * rng.normal(size=len(at)), NOISE * rng.normal(size=len(at)))  # magnitudes: Rice's distribution
    return noisy.reshape(shape[::-1]).astype(np.float32), affine


def _reach(shape: Shape, direction: Array) -> float:
    """Way from the origin to the wall along a unit vector."""
    steps = np.arange(5.0, 60.0, 0.05)
    return float(steps[np.argmax(shape(steps[:, None] * direction) > 0.0)])


def _in_scanner(shape: Shape, turned: Array, shift: Array) -> Shape:
    """The shape in the scanner's frame."""
    return lambda p: shape(p @ turned.T + shift)
