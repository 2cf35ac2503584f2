"""A page as Markdown, for the repository's documents."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from rne.plotting.html_page import PageBlock, Report, is_heading


def write_markdown(page: Report, path: Path) -> None:
    """Write a page as Markdown, and its pictures into the folder `pictures` beside it."""
    pieces = [_markdown(block) for block in page.blocks]
    first = next((k for k, block in enumerate(page.blocks) if is_heading(block)), len(pieces))
    text = "\n\n".join([f"# {page.title}", *pieces[:first], "\n".join(_contents(page)), *pieces[first:]])
    path.write_text(text + "\n", encoding="utf-8")
    for name in [block.content[0] for block in page.blocks if block.tag == "picture"]:
        (path.parent / "pictures").mkdir(exist_ok=True)
        shutil.copy(page.folder / f"{name}.png", path.parent / "pictures")


def _markdown(block: PageBlock) -> str:
    tag, content = block
    if tag == "picture":
        name, caption = content
        return f"![{caption}](pictures/{name}.png)"
    if tag == "table":
        lines = ["|".join(["", *(f" {cell.replace('|', chr(92) + '|')} " for cell in row), ""]) for row in content]
        return "\n".join([lines[0], "|---" * len(content[0]) + "|", *lines[1:]])
    return {"h2": f"## {content}", "h3": f"### {content}", "pre": f"```text\n{content}\n```"}.get(tag, content)


def _contents(page: Report) -> Iterator[str]:
    taken: dict[str, int] = {}
    for tag, text in filter(is_heading, page.blocks):
        slug = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")  # as GitHub makes them
        taken[slug] = taken.get(slug, -1) + 1
        suffix = f"-{taken[slug]}" if taken[slug] else ""
        yield f"{'  ' * (tag == 'h3')}- [{text}](#{slug}{suffix})"
