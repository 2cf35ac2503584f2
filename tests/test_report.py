"""The page of the thesis's experiments, here with its long runs cut short."""

import re
import threading
from concurrent.futures import Future

import pytest

from rne.thesis import experiments
from rne.thesis import experiments_page as thesis


@pytest.fixture
def short(monkeypatch):
    loops = tuple(run._replace(duration=0.2) for run in experiments.CLOSED_LOOPS)
    monkeypatch.setattr(experiments, "CLOSED_LOOPS", loops)
    monkeypatch.setattr(experiments, "LONG", 2.0)
    monkeypatch.setattr(experiments, "SAMPLED", (0.01, 0.01))
    here = lambda say: {name: function(*given) for name, (function, given) in experiments.JOBS.items()}  # noqa: E731
    monkeypatch.setattr(thesis, "run_all", here)


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
    markdown = (tmp_path / "docs" / "thesis.md").read_text(encoding="utf-8")
    for run in [
        "6.3-1",
        "6.3-2",
        "6.3-3",
        "6.3-4",
        "6.4-1",
        "6.5-1",
        "6.5-2",
        "6.5-3",
        "7.1-1",
        "7.1-2",
        "7.1",
        "1000 s",
    ]:
        assert run in html
        assert run in markdown
    pictures = re.findall(r'src="([^"]+)"', html)
    assert len(pictures) == 11
    for picture in pictures:
        assert (tmp_path / "page" / picture).stat().st_size > 10_000
        assert (tmp_path / "page" / picture.replace(".png", "-dark.png")).exists()
        assert f"](pictures/{picture})" in markdown
        assert (tmp_path / "docs" / "pictures" / picture).exists()
    assert 'media="(prefers-color-scheme: dark)"' in html
    assert "width=device-width" in html
    for number, heading in re.findall(r'<h2 id="s(\d+)">([^<]+)</h2>', html):
        assert f'<a href="#s{number}">{heading}</a>' in html
