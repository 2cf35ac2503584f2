"""A page as Markdown, for the repository's documents: a file with the contents, and one for each section."""

import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

from rne.plotting.html_page import PageBlock, Report, is_heading

PICTURES = 3  # of a file: about four screens


def write_markdown(page: Report, path: Path) -> None:
    """Write a page as Markdown.

    The file has what stands before the first section, and the contents. Sections are files of the folder of its name,
    pictures go into the folder `pictures` beside it.
    """
    head, *sections = _sections(page.blocks)
    files = {f"{path.stem}/{_slug(blocks[0].content)}.md": blocks for blocks in sections}
    contents = "\n".join(line for file, blocks in files.items() for line in _contents(file, blocks))
    tree = "\n".join(["```{toctree}", ":hidden:", "", *(file.removesuffix(".md") for file in files), "```"])
    pieces = [f"# {page.title}", *(_markdown(block, "pictures") for block in head), contents, tree]
    path.write_text("\n\n".join(pieces) + "\n", encoding="utf-8")
    for file, blocks in files.items():
        (path.parent / file).parent.mkdir(exist_ok=True)
        text = "\n\n".join(_markdown(block, "../pictures") for block in blocks)
        (path.parent / file).write_text(text + "\n", encoding="utf-8")
    for name in [block.content[0] for block in page.blocks if block.tag == "picture"]:
        (path.parent / "pictures").mkdir(exist_ok=True)
        shutil.copy(page.folder / f"{name}.png", path.parent / "pictures")


def _sections(blocks: Sequence[PageBlock]) -> list[list[PageBlock]]:
    """Text before the first section, and the parts of each section with their headings."""
    found: list[list[PageBlock]] = [[]]
    heading, part = "", 1
    for block in blocks:
        if block.tag == "h2":
            heading, part = block.content, 1
            found.append([])
        elif block.tag == "h3" and sum(b.tag == "picture" for b in found[-1]) >= PICTURES:
            part += 1
            found.append([PageBlock("h2", f"{heading}, part {part}")])
        found[-1].append(block)
    return found


def _markdown(block: PageBlock, pictures: str) -> str:
    tag, content = block
    if tag == "picture":
        name, caption = content
        return f"![{caption}]({pictures}/{name}.png)"
    if tag == "table":
        lines = ["|".join(["", *(f" {cell.replace('|', chr(92) + '|')} " for cell in row), ""]) for row in content]
        return "\n".join([lines[0], "|---" * len(content[0]) + "|", *lines[1:]])
    return {"h2": f"# {content}", "h3": f"## {content}", "pre": f"```text\n{content}\n```"}.get(tag, content)


def _slug(heading: str) -> str:
    """Slug of a heading as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def _contents(file: str, blocks: Sequence[PageBlock]) -> Iterator[str]:
    """Links to a section and to its headings."""
    for tag, text in filter(is_heading, blocks):
        yield f"- [{text}]({file})" if tag == "h2" else f"  - [{text}]({file}#{_slug(text)})"
