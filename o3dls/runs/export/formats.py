"""The formats of exported files: their names, suffixes and what they need."""

from __future__ import annotations

from typing import Literal

FormatName = Literal[
    "ply",
    "stl",
    "obj",
    "off",
    "vtk",
    "vtp",
    "carto_mesh",
    "openep",
    "opencarp",
    "carto_vtk",
    "dif",
    "phi_nrrd",
    "phi_nifti",
    "mask_nrrd",
    "mask_nifti",
    "tfm",
    "txt",
    "csv",
    "itk",
    "mrb",
]
FrameName = Literal["LPS", "RAS"]
SUFFIXES = {
    "carto_vtk": "carto.vtk",
    "carto_mesh": "mesh",
    "openep": "mat",
    "opencarp": "pts",
    "dif": "dif.xml",
    "phi_nrrd": "phi.nrrd",
    "phi_nifti": "phi.nii.gz",
    "mask_nrrd": "mask.nrrd",
    "mask_nifti": "mask.nii.gz",
    "csv": "points.csv",
    "itk": "to_map.h5",
}
NO_SURFACE = {
    "phi_nrrd": (".nrrd",),
    "mask_nrrd": (".nrrd",),
    "phi_nifti": (".nii", ".nii.gz"),
    "mask_nifti": (".nii", ".nii.gz"),
    "tfm": (".tfm",),
    "txt": (".txt",),
    "csv": (".csv",),
    "itk": (".h5", ".tfm"),
    "mrb": (".mrb",),
}
# the others are in one unit by definition, or by the custom of those who read them
IN_ANY_UNITS = ("ply", "stl", "obj", "off", "vtk", "vtp", "csv")
NEED_FRAME = ("phi_nifti", "mask_nifti", "tfm")  # formats that say LPS or RAS by definition
BETWEEN = ("itk", "mrb")  # formats that hold both sides, the map and the prior's image, in LPS


def file_name(estimate: str, format: str, on: str = "map") -> str:
    """Return the name of an exported file; the CARTO dialect is told from plain VTK, and what lies on the
    prior is named so.
    """
    return f"{estimate}{'_on_prior' if on == 'prior' else ''}.{SUFFIXES.get(format, format)}"
