"""An HTML document of ours as one file. Its policy lets it show pictures that are inside it and run the
scripts that we name, and no more: nothing is fetched, and nothing that a name might smuggle in runs.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence

from .markup import Html, tag


def document(
    title: str, style: str, body: Html, scripts: Sequence[str] = (), *, connects: bool = False
) -> str:
    """Write the whole page. `scripts` are the texts of script elements that may run where the body holds
    them; they may talk to the server that the page came from where it `connects`.
    """
    rules = policy(style, body, scripts) + ("; connect-src 'self'" if connects else "")
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", http_equiv="Content-Security-Policy", content=rules),
        tag("title", title),
        tag("style", Html(style)),
    )
    return f"<!doctype html>\n{tag('html', head, tag('body', body), lang='en')}\n"


def policy(style: str, body: Html, scripts: Sequence[str]) -> str:
    """Write the content security policy of a page, which names its style and scripts by their hashes."""
    own = [_hash_source(text) for text in scripts if f"<script>{text}</script>" in body]
    rules = ["default-src 'none'", "img-src data:", f"style-src {_hash_source(style)}", "base-uri 'none'"]
    return "; ".join([*rules, "form-action 'none'", *([f"script-src {' '.join(own)}"] if own else [])])


def _hash_source(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}'"
