"""The page of the thesis's experiments, here with its long runs cut short."""

import colorsys
import re
import threading
from concurrent.futures import Future

import pytest
from matplotlib.colors import to_hex

from examples.thesis import __main__ as thesis
from examples.thesis import closed_loop, experiments, formulations
from examples.thesis.markdown import write_markdown
from rne.plotting.html_page import DARK_COLORS, Report

from .helpers import FIGURES, ROOT


@pytest.fixture
def short(monkeypatch):
    loops = tuple(run._replace(duration=0.2) for run in closed_loop.CLOSED_LOOPS)
    for module in (experiments, closed_loop, formulations):
        monkeypatch.setattr(module, "CLOSED_LOOPS", loops)
    monkeypatch.setattr(closed_loop, "DIVERGING", 0.005)
    monkeypatch.setattr(experiments, "LONG", 2.0)
    monkeypatch.setattr(experiments, "SAMPLED", (0.01, 0.01))
    here = lambda say: {name: function(*given) for name, (function, given) in experiments.JOBS.items()}  # noqa: E731
    monkeypatch.setattr(thesis, "run_all", here)


def test_a_picture_is_drawn_for_light_and_for_dark_pages(tmp_path):
    """The same lines, the first of them in the first colour of each."""
    from matplotlib import image
    from matplotlib.figure import Figure

    def draw():
        figure = Figure(figsize=(1, 1))
        figure.add_axes((0, 0, 1, 1), frameon=False).plot([0, 1], [0.5, 0.5], linewidth=40)
        return figure

    report = Report("one", lambda line: None, tmp_path)
    report.figure("line", draw, "A line.")
    light, dark = (image.imread(tmp_path / f"line{kind}.png") for kind in ("", "-dark"))
    assert light.shape == dark.shape
    middle = light.shape[0] // 2, light.shape[1] // 2
    assert to_hex(dark[middle]) == DARK_COLORS[0] != to_hex(light[middle])
    assert to_hex(dark[0, 0]) == "#121212"
    assert to_hex(light[0, 0]) == "#ffffff"


def test_jobs_are_reported_as_they_finish():
    """The first job finishes only after the second one has been reported."""
    first, second = Future(), Future()
    second.set_result(2)
    lines = []

    def say(line):
        lines.append(line)
        if not first.done():
            first.set_result(1)

    rescue = threading.Timer(30, lambda: first.done() or first.set_result(None))  # a failure instead of a deadlock
    rescue.start()
    found = experiments.results_as_they_finish({"first": first, "second": second}, say)
    rescue.cancel()
    assert found == {"first": 1, "second": 2}
    assert [re.sub(r"\d+ s", "0 s", line) for line in lines] == [
        "  second: done after 0 s, 1 of 2",
        "  first: done after 0 s, 2 of 2",
    ]


@pytest.mark.long
def test_page_has_every_experiment(short, tmp_path):
    lines = []
    (tmp_path / "docs").mkdir()
    thesis.run(tmp_path / "page", lines.append, tmp_path / "docs" / "thesis.md")
    html = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
    pages = [tmp_path / "docs" / "thesis.md", *(tmp_path / "docs" / "thesis").iterdir()]
    markdown = "".join(page.read_text(encoding="utf-8") for page in pages)
    for number in FIGURES:
        assert len(re.findall(rf"^## Figure {re.escape(number)}: ", markdown, re.MULTILINE)) == 1
        assert f"figure_{number.replace('.', '_')}.png" in html
    for run in (
        "6.3-1",
        "6.3-4",
        "6.4-1",
        "6.4-2",
        "Figure 6.10",
        "6.5-3",
        "7.1-1",
        "7.1-2",
        "Table 7.1",
        "6.5.3",
        "Appendix A",
        "Appendix C",
    ):
        assert run in html
        assert run in markdown
    pictures = re.findall(r'src="([^"]+)"', html)
    assert len(pictures) == len(FIGURES) + 13
    for picture in pictures:
        assert (tmp_path / "page" / picture).stat().st_size > 10_000
        assert (tmp_path / "page" / picture.replace(".png", "-dark.png")).exists()
        assert f"pictures/{picture})" in markdown
        assert (tmp_path / "docs" / "pictures" / picture).exists()
    assert 'media="(prefers-color-scheme: dark)"' in html
    assert "width=device-width" in html
    headings = re.findall(r'<h[23] id="s(\d+)">([^<]+)</h[23]>', html)
    assert len(headings) == html.count("<h2") + html.count("<h3") > 16
    for number, heading in headings:
        assert f'<a href="#s{number}">{heading}</a>' in html
    assert "Not confirmed. Criterion: every joint within 0.01 rad" in html  # the loops are cut short
    assert html.count("<table>") == len(re.findall(r'<div class="scroll( wide)?"><table>', html)) > 5


QUANTITY = re.compile(r"(?<![\d.])(-?\d+(?:\.\d+)?(?:e-?\d+)?) (s|min|rad|J|m|1/s|N m s|N m/s|N m)(?![\w/]| s\b)")


def test_every_quantity_of_the_overview_is_on_the_page_of_experiments():
    """Rounded to the overview's digits."""
    docs = ROOT / "docs"
    overview, page = (
        QUANTITY.findall(" ".join(path.read_text(encoding="utf-8") for path in paths).replace("\n", " "))
        for paths in (
            [docs / "thesis-overview.md", docs / "thesis-claims.md"],
            [docs / "thesis.md", *(docs / "thesis").glob("*.md")],
        )
    )
    assert len(overview) > 25
    for number, unit in overview:
        digits = len(number.partition(".")[2]) if "e" not in number else 20
        assert any(u == unit and round(float(x), digits) == float(number) for x, u in page), (number, unit)


def test_every_contents_entry_of_the_markdown_has_its_heading(tmp_path):
    page = Report("Title", lambda _: None, tmp_path)
    page.text("Before the contents.")
    page.heading("6.5: PD control (thesis)")
    page.heading("Figure 6.12: control inputs of run 6.5-1", 3)
    page.heading("Last")
    page.text("Its text.")
    write_markdown(page, tmp_path / "page.md")
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == (
        "# Title\n\nBefore the contents.\n\n"
        "- [6.5: PD control (thesis)](page/65-pd-control-thesis.md)\n"
        "  - [Figure 6.12: control inputs of run 6.5-1](page/65-pd-control-thesis.md#figure-612-control-inputs-of-run-65-1)\n"
        "- [Last](page/last.md)\n\n```{toctree}\n:hidden:\n\npage/65-pd-control-thesis\npage/last\n```\n"
    )
    assert {path.name: path.read_text(encoding="utf-8") for path in (tmp_path / "page").iterdir()} == {
        "65-pd-control-thesis.md": "# 6.5: PD control (thesis)\n\n## Figure 6.12: control inputs of run 6.5-1\n",
        "last.md": "# Last\n\nIts text.\n",
    }


def test_contents_of_the_html_are_nested(tmp_path):
    page = Report("Title", lambda _: None, tmp_path)
    page.heading("One")
    page.heading("Part", 3)
    page.heading("Two")
    html = page.write().read_text(encoding="utf-8")
    contents = (
        '<nav><ul><li class="h2"><a href="#s0">One</a></li><li class="h3"><a href="#s1">Part</a></li>'
        '<li class="h2"><a href="#s2">Two</a></li></ul></nav>'
    )
    assert contents in html


def test_rows_become_lists_only_where_a_phone_needs_it(tmp_path):
    page = Report("Title", lambda _: None, tmp_path)
    page.table(["joint", "mass behind the joint [kg]"], [["joint_1", "75"]])
    page.table(["joint", *["speed"] * 4], [["shoulder_lift", *["1.5 rad/s"] * 4]])
    page.table(["link", "inertia"], [["a", ", ".join(["0.123456"] * 6)]])
    text = page.write().read_text(encoding="utf-8")
    assert re.findall(r'<div class="scroll([ a-z]*)">', text) == ["", " wide", " wide"]
    assert "<td>joint_1</td><td>75</td>" in text
    assert '<td class="long" data-label="joint">shoulder_lift</td><td data-label="speed">1.5 rad/s</td>' in text


def test_page_without_headings_has_no_contents(tmp_path):
    assert "<nav>" not in Report("Title", lambda _: None, tmp_path).write().read_text(encoding="utf-8")


def test_dark_colours_have_the_hues_of_the_light_ones():
    from matplotlib import colormaps
    from matplotlib.colors import to_rgb

    for light, dark in zip(colormaps["tab10"].colors, DARK_COLORS, strict=True):
        (hue, saturation, _), (other, _, value) = (colorsys.rgb_to_hsv(*to_rgb(c)) for c in (light, dark))
        assert abs((hue - other + 0.5) % 1 - 0.5) <= 15 / 360 or saturation == 0
        assert value >= 0.65
