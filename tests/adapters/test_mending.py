"""`convert --repair`: what people's meshes have twice, loose or inside goes, and each change is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from tiny import ball_case

from o3dls.adapters.mending import mended
from o3dls.cli.commands import cli
from o3dls.errors import InputError
from o3dls.geometry.surface import Surface, outline
from o3dls.io.meshes.repair import closed_outward
from o3dls.io.surfaces import read_surface, write_surface
from o3dls.runs.conversion import convert

BALL = ball_case(points=20).prior
V, F = BALL.vertices, BALL.faces
N = len(V)


def soup(surface: Surface) -> Surface:
    """Triangles that share no vertex, each wound as it likes."""
    faces = np.arange(3 * len(surface.faces)).reshape(-1, 3)
    faces[::3] = faces[::3, ::-1]
    return Surface(surface.vertices[surface.faces].reshape(-1, 3), faces)


def rounded(surface: Surface) -> Surface:
    """A soup whose corners a program rounded each in its own way."""
    wide = soup(surface)
    noise = np.random.default_rng(3).normal(size=wide.vertices.shape)
    return wide.with_vertices(wide.vertices + 1e-8 * noise)


def partition() -> Surface:
    """A ball that a disc parts in two: the edges of the disc have more than two faces."""
    import trimesh

    box = trimesh.creation.box((40, 40, 40)).subdivide().subdivide()
    flat = np.abs(box.vertices[:, 2]) < 1e-9  # the ring around the middle
    ring = np.flatnonzero(flat)
    angle = np.arctan2(box.vertices[ring, 1], box.vertices[ring, 0])
    ring = ring[np.argsort(angle)]
    centre = len(box.vertices)
    disc = np.column_stack([ring, np.roll(ring, -1), np.full(len(ring), centre)])
    return Surface(np.vstack([box.vertices, [[0.0, 0, 0]]]), np.vstack([box.faces, disc]))


DAMAGED = {
    "faces twice": (Surface(V, np.vstack([F, F[:7]])), 1.0, "7 faces that are there twice"),
    "faces twice, turned": (Surface(V, np.vstack([F, F[:7, ::-1]])), 1.0, "7 faces that are there twice"),
    "loose vertices": (Surface(np.vstack([V, V[:5] * 3]), F), 1.0, "5 vertices without a face"),
    "no area": (Surface(V, np.vstack([F, [[0, 0, 1]]])), 1.0, "1 faces that are there twice or have no area"),
    "inner wall": (
        Surface(np.vstack([V, 0.8 * V]), np.vstack([F, F + N])),
        1.0,
        f"{len(F)} faces that do not part",
    ),
    "inner wall, turned": (
        Surface(np.vstack([V, 0.8 * V]), np.vstack([F, F[:, ::-1] + N])),
        1.0,
        "do not part",
    ),
    "soup": (soup(BALL), 1.0, "vertices at the place of another"),
    "rounded soup": (rounded(BALL), 1.0, "vertices at the place of another"),
    "fin": (
        Surface(np.vstack([V, V[F[0, :1]] * 2]), np.vstack([F, [[F[0, 0], F[0, 1], N]]])),
        1.0,
        "1 faces that do not part inside from outside",
    ),
    "partition": (partition(), 40.0**3 / BALL.volume, "faces that do not part inside from outside"),
}


@pytest.mark.parametrize("kind", DAMAGED)
def test_what_is_twice_loose_or_inside_is_left_out(kind: str) -> None:
    damaged, ratio, change = DAMAGED[kind]
    found, said = mended(damaged, "la.stl")
    closed = closed_outward(found, "la.stl")
    assert closed.watertight
    assert closed.volume == pytest.approx(ratio * BALL.volume, rel=1e-6)
    assert [line for line in said if change in line]


def test_a_surface_that_is_well_stays_as_it_is() -> None:
    found, said = mended(BALL, "la.stl")
    np.testing.assert_array_equal(found.vertices, BALL.vertices)
    np.testing.assert_array_equal(found.faces, BALL.faces)
    assert said == ["nothing was to be mended"]


def test_two_chambers_side_by_side_both_stay() -> None:
    two = Surface(np.vstack([V, V + 100.0]), np.vstack([F, F + N]))
    assert mended(two, "la.stl")[0].volume == pytest.approx(2 * BALL.volume)


def test_fields_stay_with_their_vertices() -> None:
    damaged, _, _ = DAMAGED["inner wall"]
    height = damaged.vertices[:, 2].copy()
    found, _ = mended(Surface(damaged.vertices, damaged.faces, {"height": height}), "la.stl")
    np.testing.assert_array_equal(found.fields["height"], found.vertices[:, 2])


def test_the_sentence_that_refuses_names_the_mend(tmp_path: Path) -> None:
    write_surface(tmp_path / "la.ply", DAMAGED["partition"][0])
    with pytest.raises(InputError, match="mend it with `o3dls convert --repair`"):
        convert(tmp_path / "la.ply", tmp_path / "out.ply", cap=True)
    done = CliRunner().invoke(
        cli, ["convert", str(tmp_path / "la.ply"), str(tmp_path / "out.ply"), "--repair"]
    )
    assert done.exit_code == 0, done.output
    assert "faces that do not part inside from outside are left out" in done.output
    assert read_surface(tmp_path / "out.ply").watertight


def test_what_has_no_inside_is_refused(tmp_path: Path) -> None:
    sheet = Surface(
        np.array([[0.0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9], [9, 9, 9]]),
        np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]),
    )
    with pytest.raises(InputError, match="no part of it has an inside: is it closed"):
        mended(sheet, "la.stl")
    ring = outline(np.array([[0.0, 0], [9, 0], [9, 9]]))
    with pytest.raises(InputError, match="repair is for surfaces in 3D"):
        mended(ring, "la.csv")
