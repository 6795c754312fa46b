"""Colour maps of the report, by the corners between which their colours change evenly: read here, since
matplotlib takes half a second to be imported.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array

FIRST = 0.08  # share of a map's light end that is left out: it would be lost on white
PURPLE = 0.78  # share of the circle of hues from red to purple
ENTRIES = 256

# Maps of ColorBrewer 2.0 (Brewer, Harrower; Apache-2.0), plasma (Smith, van der Walt; CC0), tab20 (Tableau)
CORNERS = {
    "YlGnBu": "ffffd9 edf8b1 c7e9b4 7fcdbb 41b6c4 1d91c0 225ea8 253494 081d58",
    "BuPu": "f7fcfd e0ecf4 bfd3e6 9ebcda 8c96c6 8c6bb1 88419d 810f7c 4d004b",
    "YlOrRd": "ffffcc ffeda0 fed976 feb24c fd8d3c fc4e2a e31a1c bd0026 800026",
    "RdBu_r": "053061 2166ac 4393c3 92c5de d1e5f0 f7f7f7 fddbc7 f4a582 d6604d b2182b 67001f",
    "plasma": "0d0887 3a049a 5c01a6 7e03a8 9c179e b52f8c cc4778 de5f65 ed7953 f89540 fdb42f fbd524 f0f921",
    "hsv": "ff0000 ffff00 00ff00 00ffff 0000ff ff00ff ff0000",
    "tab20": "1f77b4 aec7e8 ff7f0e ffbb78 2ca02c 98df8a d62728 ff9896 9467bd c5b0d5"
    " 8c564b c49c94 e377c2 f7b6d2 7f7f7f c7c7c7 bcbd22 dbdb8d 17becf 9edae5",
}

# The map of a kind of values, and the share of it that is used. Those that colour-blind readers can order
# have light small values, so that the shape stays visible where all is well; `mapping` is what labs of
# electrophysiology know: red is low (scar) and early, purple is high (healthy) and late.
MAPS = {
    "sequential": ("YlGnBu", FIRST, 1.0),
    "deviation": ("BuPu", FIRST, 1.0),
    "signed": ("RdBu_r", 0.0, 1.0),
    "electrical": ("plasma", 0.0, 1.0),
    "mapping": ("hsv", 0.0, PURPLE),
    "points": ("YlOrRd", FIRST, 1.0),
    "regions": ("tab20", 0.0, 1.0),  # twenty colours, a region each
}
LOW_ENDS = {"signed": "blue", "electrical": "dark", "mapping": "red"}  # all other maps begin light


def colour_table(colours: str) -> Array:
    """Return the ENTRIES colours (256, 3) in [0, 1] of one of MAPS."""
    name, first, last = MAPS[colours]
    corners = np.array([list(bytes.fromhex(corner)) for corner in CORNERS[name].split()]) / 255
    at = np.linspace(first, last, ENTRIES)
    if name == "tab20":  # regions are told apart: no colour lies between two
        return np.asarray(corners[np.minimum((at * len(corners)).astype(int), len(corners) - 1)])
    places = np.linspace(0.0, 1.0, len(corners))
    return np.column_stack([np.interp(at, places, channel) for channel in corners.T])
