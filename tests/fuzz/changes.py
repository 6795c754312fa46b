"""Changes of whole files that keep most of them as it is, for hypothesis."""

from __future__ import annotations

from hypothesis import strategies as st

MOST = 6  # changes of one file


@st.composite
def changed(draw: st.DrawFn, seeds: list[bytes]) -> bytes:
    """One of the seeds, with bytes put in, cut out, changed or doubled at a few places."""
    data = bytearray(draw(st.sampled_from(seeds)))
    for _ in range(draw(st.integers(0, MOST))):
        at = draw(st.integers(0, len(data)))
        until = min(len(data), at + draw(st.integers(0, 64)))
        other = draw(st.one_of(st.binary(max_size=16), st.just(bytes(data[at:until]) * 2)))
        data[at:until] = other
    return bytes(data)
