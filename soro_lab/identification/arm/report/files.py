"""The pictures of a page as files, for a talk or a paper."""

from __future__ import annotations

import base64
import re
from html import unescape
from pathlib import Path

_PICTURE = re.compile(r'<img alt="([^"]*)" src="data:image/(svg|png)[^,]*;base64,([^"]*)"')


def write_pictures(text: str, folder: Path) -> None:
    """Write each picture of a page, under a name of what it shows.

    Parameters
    ----------
    text : str
        HTML with pictures as data.
    folder : Path
        Made where it does not exist.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for shows, kind, data in _PICTURE.findall(text):
        name = re.sub(r"\W+", "_", unescape(shows).lower()).strip("_")
        (folder / f"{name}.{kind}").write_bytes(base64.b64decode(data))
