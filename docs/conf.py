"""The documentation site: python -m sphinx -W docs build/docs"""

import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_extensions"))

import public  # noqa: E402

import rne  # noqa: E402

project = "rne"
author = "the authors of rne"
copyright = "the authors of rne, BSD 2-Clause"
version = release = rne.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "myst_parser",
    "sphinx_gallery.gen_gallery",
    "mathml",
    "bars",
    "charts",
]
exclude_patterns = ["_extensions", "tutorials", "Thumbs.db"]  # the gallery copies tutorials to generated/tutorials
templates_path = ["_templates"]
suppress_warnings = ["sphinx_gallery.config"]  # that the list of tutorials is by file, which is meant
nitpicky = True
nitpick_ignore_regex = [
    # Words of a docstring's types, and names that Sphinx has no page for; those of rne itself are all checked.
    (r"py:.*", r"(?!rne).*"),
]

# Formulas are MathML, which browsers show without scripts or network.
html_math_renderer = "mathml"
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 4

autosummary_generate = True
autosummary_context = {
    "member_lists": public.member_lists(),
    "own_pages": public.OWN_PAGES,
    "summaries": public.summaries(),
}
autosummary_ignore_module_all = False
autodoc_typehints = "none"  # the docstrings' types are read by people
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
default_role = "py:obj"

html_theme = "furo"
html_title = f"rne {release}"
html_static_path = ["_static"]
html_css_files = ["rne.css"]
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
pygments_dark_style = "monokai"

sphinx_gallery_conf = {
    "examples_dirs": ["tutorials"],
    "gallery_dirs": ["generated/tutorials"],
    "copyfile_regex": r"index\.rst",  # written by hand: tutorials by level
    "filename_pattern": r"\.py$",
    "within_subsection_order": "levels.position",
    "minigallery_sort_order": "levels.position",
    "image_scrapers": ("figures.scrape",),
    "reset_modules": (),
    "capture_repr": ("_repr_html_", "__repr__"),
    "ignore_repr_types": r"matplotlib",
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "remove_config_comments": True,
    "write_computation_times": False,
    "plot_gallery": True,
    "first_notebook_cell": "%matplotlib inline",  # figures made without pyplot show too
}


def remove_stale_pages(app):
    """Forget pages that an earlier build generated from names and tutorials that are gone."""
    kept = public.pages() | {path.stem for path in (HERE / "tutorials").glob("*.py")}
    for page in (HERE / "generated").rglob("*.rst"):
        if page.stem not in kept | {"index"}:
            page.unlink()


def skip_member(app, what, name, thing, skip, options):
    """Leave out what is internal, and the fields of records, which the docstring lists."""
    owner = getattr(thing, "__qualname__", "") or getattr(getattr(thing, "func", None), "__qualname__", "")
    owner = owner or getattr(getattr(thing, "fget", None), "__qualname__", "")
    is_field = what == "class" and not public.is_member(thing)
    return True if skip or is_field or owner in public.INTERNAL else None


def link_to_gallery(app, docname, source):
    """The list of tasks links tutorials as files of the repository, so that its links work there too."""
    source[0] = re.sub(r"\]\(tutorials/(\w+)\.py\)", r"](generated/tutorials/\1.rst)", source[0])


def setup(app):
    app.connect("source-read", link_to_gallery)
    app.connect("builder-inited", remove_stale_pages, priority=100)
    app.connect("autodoc-skip-member", skip_member)
