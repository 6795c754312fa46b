"""Every option that a sentence names is one of the command that prints it, and lines of case.toml are advised
where a case folder is read.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from said import said_by

import o3dls
from o3dls.cli.commands import cli
from o3dls.errors import InputError
from tests.cli.followed import COMMAND, strings

nibabel = pytest.importorskip("nibabel")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
READERS = ("convert", "init", "import")
# who prints the sentences of a module or folder: each of them must have the options; the longest name counts
PRINTED_BY = {
    "io/images/": READERS,
    "io/meshes/": READERS,
    "io/case_coordinates": READERS,
    "io/mapping/": ("import",),
    "io/matlab/": ("import",),
    "io/table": ("convert", "init"),
    "io/tables/": ("convert", "init"),
    "io/points": ("convert", "init"),
    "columns": ("convert", "init"),
    "io/markups": ("convert",),
    "io/case_settings": ("run",),
    "io/case_reader": ("run",),
    "io/atomic": ("init", "import", "run", "demo"),
    "runs/conversion": ("convert",),
    "runs/stated": ("convert",),
    "live/": ("live",),
    "pipeline/new_case": ("init",),
    "pipeline/outcome": ("run",),
    "pipeline/batch": ("batch",),
    "pipeline/scheduler": ("batch",),
    "pipeline/supervision": ("batch",),
    "pipeline/on_worker": ("batch",),
}
# options for others, patterns and colours of a page
NO_SENTENCES = ("cli/", "adapters/keywords", "report/drawing/scene", "report/sections/cross_sections")
OF_OTHERS = ("gdcmconv --raw",)


def sentences() -> Iterator[tuple[str, int, str]]:
    """The strings of the program that name an option; `--{}` names none that is known here."""
    for name, line, text in strings():
        for other in OF_OTHERS:
            text = text.replace(other, "")
        if OPTION.search(text) and not name.startswith(NO_SENTENCES):
            yield name, line, text


def options_of(command: str) -> set[str]:
    return {name for one in cli.commands[command].params for name in (*one.opts, *one.secondary_opts)}


SENTENCES = list(sentences())


def test_the_sentences_are_found() -> None:
    assert len(SENTENCES) > 40
    assert {"io/images/nifti", "io/meshes/repair", "live/sources/replay"} <= {
        name for name, _, _ in SENTENCES
    }


@pytest.mark.parametrize(("name", "line", "text"), SENTENCES, ids=[f"{n}:{k}" for n, k, _ in SENTENCES])
def test_an_option_that_a_sentence_names_is_one_of_its_command(name: str, line: int, text: str) -> None:
    named = [one for one in COMMAND.findall(text) if one in cli.commands]
    known = max((key for key in PRINTED_BY if name.startswith(key)), key=len, default=None)
    printers = named or PRINTED_BY.get(known or "", ())
    every = {option for command in cli.commands for option in options_of(command)}
    for option in OPTION.findall(text):
        if printers:
            has = [option in options_of(command) for command in printers]
            assert any(has) if named else all(has), (
                f"{name}:{line}: {option} of {', '.join(printers)}: {text}"
            )
        else:
            assert option in every, f"{name}:{line}: {option}: {text}"


AT = np.indices((40, 40, 40)) - 19.5
BALL = (AT**2).sum(axis=0) < 15.0**2


def prior_of(kind: str, folder: Path) -> None:
    """A prior whose file asks for a decision."""
    mask, affine = BALL.astype(np.uint8), np.eye(4)
    if kind == "label":
        mask[:4, :4, :4] = 2
    if kind == "fill_slices":
        mask[:, :, 12:26:2] = 0
    if kind == "box":
        mask = np.pad(mask, ((0, 40), (0, 40), (0, 0)))
        mask[54:76, 54:76, 8:30] = 1
    if kind == "layer":
        mask = np.stack([mask, mask], axis=-1)
    image = nibabel.Nifti1Image(mask, affine)
    image.header.set_xyzt_units("mm")
    image.set_sform(affine, code=1)
    if kind == "form":
        affine[0, 3] = 50.0
    image.set_qform(affine, code=1)
    nibabel.save(image, folder / "prior.nii.gz")
    if kind == "sidecar":
        (folder / "prior.json").write_text('{"SpacingBetweenSlices": 2.0}')


LINES = {
    "label": ("say label \\(there are 1, 2\\), in case.toml$", "label = 1"),
    "layer": ("say layer \\(0 to 1\\), in case.toml$", "layer = 0"),
    "form": ('(form = "sform") or form = "qform"', None),
    "sidecar": ('(sidecar = "ignore") where', None),
    "fill_slices": ("(fill_slices = true), which", None),
    "box": ("(box = \\[[^]]*\\])", None),
    "columns": ('(columns = "bipolar=)HEADING"', 'columns = "bipolar=Bip"'),
}


@pytest.mark.parametrize("kind", LINES)
def test_what_is_advised_of_a_case_folder_is_a_line_of_case_toml(kind: str, tmp_path: Path) -> None:
    """The commands that read one have no such option."""
    prior_of(kind, tmp_path)
    ways = np.random.default_rng(15_221).normal(size=(80, 3))
    xyz = [-19.5, -19.5, 19.5] + 15.0 * ways / np.linalg.norm(ways, axis=1)[:, None]
    values = ",Bi,Bip" if kind == "columns" else ""
    rows = "".join(f"{x},{y},{z}{',1,2' * bool(values)}\n" for x, y, z in xyz)
    (tmp_path / "points.csv").write_text(f"# units=mm\nx,y,z{values}\n{rows}")
    (tmp_path / "plan.toml").write_text('case = "."\nout = "run"\n[[stage]]\nuse = "icp"\n')
    said = said_by("check", tmp_path / "plan.toml")[1]
    pattern, line = LINES[kind]
    found = re.search(pattern, said.strip())
    assert found, said
    assert not OPTION.search(said), said
    (tmp_path / "case.toml").write_text(f"{line or found[1]}\n")
    code, said = said_by("check", tmp_path / "plan.toml")
    assert code == 0, said


def test_units_of_a_case_folder_are_advised_as_option_and_as_line(tmp_path: Path) -> None:
    """`o3dls run` has the option, `o3dls check` has not."""
    prior_of("", tmp_path)
    rows = "".join(f"{x / 1000},{y / 1000},{z / 1000}\n" for x, y, z in AT.reshape(3, -1).T[:400])
    (tmp_path / "points.csv").write_text(f"x,y,z\n{rows}")
    with pytest.raises(InputError, match=r'say --units m, else --units mm, or units = "m" and so on in case'):
        o3dls.read_case(tmp_path)
    (tmp_path / "case.toml").write_text('units = "m"\n')
    assert len(o3dls.read_case(tmp_path).points) == 400


def test_columns_that_a_table_asks_for_are_said_to_convert_too(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("# units=mm\nx,y,z,Bi,Bip\n1,2,3,4,5\n100,2,3,4,6\n")
    convert = ("convert", tmp_path / "p.csv", tmp_path / "out.csv")
    code, said = said_by(*convert)
    assert code == 2
    assert "say --columns bipolar=HEADING" in said
    code, said = said_by(*convert, "--columns", "bipolar=Bip")
    assert code == 0, said
    assert o3dls.read_points(tmp_path / "out.csv").columns["bipolar"].tolist() == [5.0, 6.0]
    pose = tmp_path / "pose.txt"
    pose.write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    code, said = said_by("convert", pose, tmp_path / "out.tfm", "--frame", "LPS", "--columns", "x=y")
    assert "columns do not apply to it" in said


KEYWORDS = {  # what is typed in Python, or the number that is listed for it
    "label": r"say (label=) \(there are (\d+), \d+\)$",
    "layer": r"say (layer=) \(0 to (\d+)\)$",
    "form": r"say form='sform' or (form=)('qform'), or",
    "fill_slices": r"say (fill_slices=)(True), which",
    "box": r"cut to it with (box=)(\([^)]*\)), else",
    "frame": r"and say (frame=)('RAS') where",
}


@pytest.mark.parametrize("kind", KEYWORDS)
def test_objects_are_told_of_keywords_that_they_take(kind: str, tmp_path: Path) -> None:
    prior_of(kind, tmp_path)
    image = nibabel.load(tmp_path / "prior.nii.gz")
    if kind == "frame":
        image.set_sform(None, code=0)
        image.set_qform(None, code=0)
    with pytest.raises(InputError, match=KEYWORDS[kind]) as refused:
        o3dls.surface_of(image)
    assert not OPTION.search(str(refused.value))
    found = re.search(KEYWORDS[kind], str(refused.value))
    assert found
    given = {found[1].rstrip("="): ast.literal_eval(found[2])}
    assert o3dls.surface_of(image, **given).volume > 1000.0
