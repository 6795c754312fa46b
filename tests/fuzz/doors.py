"""The doors by which bytes of anybody come in; the seeds of each are whole files, and what once broke it."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from o3dls.errors import O3dlsError
from o3dls.io.documents import parse_toml
from o3dls.io.images.volumes import write_volume
from o3dls.io.mapping import igtl
from o3dls.io.mapping.igtl_received import BadMessage, points_of, receive, transform_of
from o3dls.io.mapping.study import read_study
from o3dls.io.points import points_of as points_of_table
from o3dls.io.surfaces import read_surface_file
from o3dls.io.table import table_of
from o3dls.live.journal import begin_journal, read_journal
from o3dls.live.messages import action, parse_action
from o3dls.pipeline.file import pipeline_from
from o3dls.report.mapping.on_wall import read_lesions
from o3dls.runs.folder import read_record
from o3dls.runs.posterior_file import read_posterior
from tests.finished import finished
from tests.formats import write_as
from tests.io.test_io_study import carto_folder, zipped

SURFACES = ("ply", "vtk", "vtp", "off", "obj", "stl", "carto_vtk", "carto_mesh", "dif")
# arrays of a posterior of two points, three nodes and one length
POSTERIOR = {
    **dict.fromkeys(("nodes", "normals", "where", "unfollowed"), (3, 3)),
    **dict.fromkeys(("at", "directions"), (2, 3)),
    **dict.fromkeys(("normal_part", "residual", "errors", "lengths"), (2,)),
    "centre": (3,),
    "scales": (5,),
    "inflation": (1,),
    "correlation": (2,),
    "anchors": (0, 3),
    "sds": (4,),
}
DEEP = b"[" * 20_000
HALF = b'{"do": "take", "xyz": [1, 2, 3], "values": {"a": "\\ud800"}}'
LONG = b'{"do": "take", "xyz": [' + b"9" * 400 + b", 1, 2]}"
LONGER = b'{"do": "take", "xyz": [' + b"9" * 5000 + b", 1, 2]}"
TAKE = b'{"do": "take", "xyz": [1, 2, 3], "type": "eam", "values": {"bipolar": 1.5, "name": "a"}}'


@dataclass(frozen=True)
class Door:
    """What reads bytes: it may raise O3dlsError, and nothing else."""

    read: Callable[[bytes], object]
    seeds: Callable[[], list[bytes]]

    def __call__(self, data: bytes) -> None:
        with suppress(O3dlsError, BadMessage):
            self.read(data)


@cache
def work() -> Path:
    return Path(tempfile.mkdtemp(prefix="o3dls-fuzz-"))


def as_file(name: str, data: bytes) -> Path:
    path = work() / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def surface_seeds() -> list[bytes]:
    folder = work() / "seeds"
    folder.mkdir(exist_ok=True)
    return [write_as(name, folder).read_bytes() for name in SURFACES]


def volume_seeds() -> list[bytes]:
    labels = np.zeros((9, 8, 7), np.uint8)
    labels[2:7, 2:6, 2:5] = 1
    found = []
    for suffix in ("nrrd", "nii", "nii.gz"):
        write_volume(work() / f"seed.{suffix}", labels, np.eye(4), space="LPS")
        found.append((work() / f"seed.{suffix}").read_bytes())
    head = b"NDims = 3\nDimSize = 7 8 9\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    long = head.replace(b"LOCAL", b"\xff" * 150)  # 450 bytes as the name of a file
    return [*found, head + labels.tobytes(), long]


def read_volume(data: bytes) -> object:
    return read_surface_file(as_file("volume.bin", data), frame="LPS")


def study_seeds() -> list[bytes]:
    folder = Path(tempfile.mkdtemp(dir=work()))
    return [zipped(carto_folder(folder / "s"), folder / "study.zip").read_bytes()]


def run_json_seeds() -> list[bytes]:
    text = (finished(Path(tempfile.mkdtemp(dir=work())) / "run") / "run.json").read_bytes()
    return [text, b'{"schema": "o3dls/run/2"}', DEEP, text.replace(b'"mm"', b'"\\ud800"')]


def journal_seeds() -> list[bytes]:
    folder = Path(tempfile.mkdtemp(dir=work()))
    begin_journal(folder, {"case": "c", "prior": "p"}, [json.loads(TAKE), {"do": "end"}]).close()
    whole = (folder / "journal.jsonl").read_bytes()
    head, *rest = whole.split(b"\n")
    return [
        whole,
        head.replace(b'"case"', b'"cave"'),  # KeyError
        head.replace(b'"prior": "p"', b'"prior": 1'),  # TypeError
        b"\n".join([head, DEEP]),  # RecursionError
        *(b"\n".join([head, one, *rest]) for one in (HALF, LONG, LONGER)),
    ]


def posterior_seeds() -> list[bytes]:
    """Rows as a run keeps them, plain and compressed, and a header that promises more than there is."""
    arrays = {name: np.ones(shape) for name, shape in POSTERIOR.items()}
    found = []
    for save in (np.savez, np.savez_compressed):
        save(content := io.BytesIO(), **arrays)
        found.append(content.getvalue())
    huge = b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 3), }"
    npy = b"\x93NUMPY\x01\x00" + len(huge).to_bytes(2, "little") + huge
    with zipfile.ZipFile(content := io.BytesIO(), "w") as packed:
        for name in arrays:
            packed.writestr(f"{name}.npy", npy)
    return [*found, content.getvalue()]


def lesion_seeds() -> list[bytes]:
    return [
        b"x,y,z,name,line,sigma\n1,2,3,a,roof,0.5\n4,5,6,b,roof,\n7,8,9,c,floor,1\n",
        b"x,y,z,type,line\n1,2,3,ablation,1\n4,5,6,eam,2\n",
        b"x,y,z,sigma\n1,2,3,-1\n",
        b"x,y,z,line\n1,2,3,\xff\n",
    ]


def toml_seeds() -> list[bytes]:
    text = b'case = "a"\nfolds = 3\n[[stage]]\nuse = "icp"\nkeep = 0.9\n[[write]]\nuse = "report"\n'
    return [text, b"a" + b".a" * 3000 + b" = 1", b"a = " + b"[" * 5000, b"a = " + b"9" * 5000]


def igtl_seeds() -> list[bytes]:
    xyz = np.arange(6.0).reshape(2, 3)
    return [igtl.points(["a", "b"], xyz), igtl.transform(np.eye(4)), igtl.message("STATUS", "s", b"")]


def read_igtl(data: bytes) -> None:
    left = memoryview(data)

    def read(count: int) -> bytes:
        nonlocal left
        taken, left = left[:count], left[count:]
        return bytes(taken)

    while left:
        try:
            message = receive(read)
            (points_of if message.kind == "POINT" else transform_of)(message)
        except BadMessage:
            continue


DOORS = {
    "surface": Door(lambda data: read_surface_file(as_file("surface.bin", data)), surface_seeds),
    "volume": Door(read_volume, volume_seeds),
    "study": Door(lambda data: read_study(as_file("study/study.zip", data), "1-Map"), study_seeds),
    "table": Door(
        lambda data: points_of_table(table_of(data, Path("p.csv"), "xyz"), 3),
        lambda: [
            b"# units=mm space=LPS\nx,y,z,type,name\n1,2,3,eam,a\n4,5,6,landmark,b\n",
            b"x;y;z\n1;2;3\n",
        ],
    ),
    "toml": Door(
        lambda data: pipeline_from(parse_toml(data.decode("utf-8", "replace"), "p.toml")), toml_seeds
    ),
    "journal": Door(lambda data: read_journal(as_file("journal.jsonl", data)), journal_seeds),
    "action": Door(
        lambda data: action(parse_action(data, "line 1")), lambda: [TAKE, DEEP, HALF, LONG, LONGER, b"null"]
    ),
    "posterior": Door(lambda data: read_posterior(as_file("posterior_rows.npz", data), 3), posterior_seeds),
    "lesions": Door(lambda data: read_lesions(as_file("lesions.csv", data), 1.0), lesion_seeds),
    "run.json": Door(lambda data: read_record(as_file("run/run.json", data).parent), run_json_seeds),
    "igtl": Door(read_igtl, igtl_seeds),
}
