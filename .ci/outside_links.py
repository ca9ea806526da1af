"""For mkdocs: links to files of the repository outside of docs/ lead to the repository's page."""

import re
from posixpath import dirname, join, normpath
from typing import Any

TARGET = re.compile(r"(?<=\]\()(\.\./[^)\s]+)(?=\))")


def on_page_markdown(markdown: str, *, page: Any, config: Any, **_: Any) -> str:
    """The text of a page with these links absolute."""

    def absolute(found: re.Match[str]) -> str:
        path = normpath(join("docs", dirname(page.file.src_uri), found[1]))
        return found[1] if path.startswith("docs/") else f"{config.repo_url}/blob/main/{path}"

    return TARGET.sub(absolute, markdown)
