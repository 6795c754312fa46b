"""The colours of estimates: one for each method, the same in report, slides, cohort and paper.

Told apart by colour-blind readers, after Okabe and Ito, and dark or light enough for text on their page.
"""

from __future__ import annotations

from collections.abc import Sequence

LIGHT = ("#0072b2", "#c04f00", "#00785a", "#a3487e", "#6b6b00", "#5b5f66")  # on a light page
DARK = ("#56b4e9", "#f28e3c", "#2fc79c", "#de94c0", "#d9cf4a", "#aab0b8")  # the same hues on a dark one
GREY = 5  # for the prior, and for lines of reference
METHODS = {
    "level_set": 0,
    "icp": 1,
    "deform": 2,
    "landmarks": 3,
    "paper": 3,
    "given": GREY,
    "start": 4,
    "similarity": 4,
}
ORDER = (2, 3, 4, 0, 1, GREY)  # other methods take free colours in this order: ours and the ICP's come last


def colour_of(method: str) -> str:
    """Return the colour of a method of METHODS on a light page."""
    return LIGHT[METHODS[method]]


def places(methods: Sequence[str]) -> list[int]:
    """Return the number of the colour and dash of each method, the most important first, so that they differ.

    It is the method's own where no other has it, else the next that is free; where all are taken, a number
    beyond them.
    """
    found: list[int] = []
    for method in methods:
        own = [place for name, place in METHODS.items() if method.startswith(name)]
        free = [place for place in (*own, *ORDER) if place not in found]
        found.append(free[0] if free else len(found))
    return found


def variables() -> str:
    """Write the colours as variables --s0 to --s5 of a style sheet, light and dark.

    Paper is light, and so are pictures that are made for it (class `printing` of print.js).
    """
    light, dark = (
        "{ " + " ".join(f"--s{k}: {colour};" for k, colour in enumerate(colours)) + " }"
        for colours in (LIGHT, DARK)
    )
    return (
        f":root {light}\n@media screen and (prefers-color-scheme: dark) {{ :root:not(.printing) {dark} }}\n"
    )
