"""The report of a study: whole, and by itself."""

import os
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from importlib.metadata import version

import kelvin_voigt  # noqa: F401 - makes the model known
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image
from tools import run

from shear_sim import report as module
from shear_sim.aggregate import make_tables
from shear_sim.figures import style
from shear_sim.report import page, write_report
from shear_sim.results import Failure, Results, ResultsError
from shear_sim.runner import run_job
from shear_sim.statistics import RESAMPLES
from shear_sim.study import load_study

STUDY = """# <script src="https://example.org/evil.js"></script> & an "attribute" > all
model: {kind: kelvin_voigt, noise: 2.0}
scenes:
  stiff: {model.modulus: 400}
  soft: {model.modulus: 50}
sweep:
  grid: {shear.strain_amplitude: [0.01, 0.1, 1.0]}
replicates: 3
seed: 5
"""
NOTHING_TO_DRAW = "model: {kind: kelvin_voigt}\nreplicates: 2\n"
VOID = {"meta", "img", "br", "hr", "link", "input"}
LOADS = {"src", "srcset", "href", "xlink:href", "data", "poster", "action", "background", "style"}


class Page(HTMLParser):
    """What a page holds; that its elements are closed in order is asserted."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.text = [], [], {}
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        assert len(dict(attrs)) == len(attrs)
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        inner = self.open[-1] if self.open else ""
        self.text[inner] = self.text.get(inner, "") + data

    def all(self, tag):
        return [attrs for name, attrs in self.elements if name == tag]


def plan(folder, text=STUDY):
    file = folder / "springs.yaml"
    file.write_text(text)
    study = load_study(file)
    results = Results(folder / "results" / "springs")
    results.prepare(study)
    return study, results


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of a study of which one job failed and one has not run."""
    study, results = plan(tmp_path_factory.mktemp("report"))
    failed, _missing, *others = study.jobs()
    for job in others:
        run_job(job, results.jobs)
    results.record_failure(Failure(failed.id, "physics", "the spring broke: 1 < 2 & so on"))
    assert write_report(results.folder) == results.folder / "report.html"
    return results


@pytest.fixture(scope="module")
def text(results):
    return (results.folder / "report.html").read_text("utf-8")


@pytest.fixture(scope="module")
def parsed(text):
    return Page(text)


def test_it_refers_to_nothing_outside_itself(text, parsed):
    names = {attrs["id"] for _, attrs in parsed.elements if "id" in attrs}
    for tag, attrs in parsed.elements:
        assert tag not in {"script", "link", "iframe", "object", "embed", "base", "form", "video"}
        for name in LOADS & attrs.keys():
            value = attrs[name]
            inside = value.startswith("data:image/png;base64,")
            inside |= value.startswith("#") and value[1:] in names
            inside |= name == "style" and "(" not in value
            assert inside, (tag, name, value[:80])
        assert not any(name.startswith("on") for name in attrs), attrs
    assert re.search(r"url\(|@import|@font-face|expression\(", parsed.text["style"]) is None
    assert len(parsed.all("style")) == 1
    # Other addresses stand in the text of the study file alone, as text.
    assert re.findall(r"https?://[^\s&]*", text) == ["https://example.org/evil.js"]


def test_every_figure_is_there_with_its_words(results, parsed):
    images = parsed.all("img")
    assert len(images) == len(list(results.figures.glob("*.png"))) >= 6
    assert len({image["src"] for image in images}) == len(images)
    for image in images:
        assert len(image["alt"]) > 20
        inches = float(re.fullmatch(r"width:([\d.]+)in", image["style"])[1])
        assert inches == pytest.approx(int(image["width"]) / style.DPI, abs=0.01)
        assert inches <= style.DOUBLE


def test_it_says_how_much_is_there_and_what_went_wrong(text, parsed):
    assert "PARTIAL STUDY: 16 of 18 runs (1 failed, 1 not yet run)" in parsed.text["li"]
    assert {"class": "partial"} in parsed.all("div")
    assert "the spring broke: 1 < 2 & so on" in parsed.text["td"]
    assert "1 &lt; 2 &amp; so on" in text
    # 2 Pa of noise, at 1 % strain, in all replicates.
    assert re.search(r"3 of 3(\w+ \d; )*baseline_noise 3", parsed.text["td"])
    assert "Points with flagged runs" in parsed.text["caption"]


def test_it_says_what_was_run_and_how(text, parsed):
    assert parsed.text["pre"] == STUDY
    assert f"shear-sim {version('shear-sim')}" in parsed.text["p"]
    assert np.__version__ in parsed.text["td"]
    assert f"{RESAMPLES:,} resamples (seed 5)" in parsed.text["p"]
    assert "t_log, " in parsed.text["li"]
    assert "model.modulusPa50, 400" in re.sub(r"<[^>]*>", "", text)
    assert parsed.text["title"] == "springs: report of a study"


def test_a_whole_study_has_no_warning(tmp_path):
    """And one without curves, landmarks or contrasts has no words about them."""
    study, results = plan(tmp_path, NOTHING_TO_DRAW)
    for job in study.jobs():
        run_job(job, results.jobs)
    found = page(results, make_tables(results.folder))
    assert Page(found).text["li"].startswith("2 of 2 runs")
    assert "PARTIAL" not in found
    assert 'class="partial"' not in found
    assert "There is nothing to draw yet." in found
    assert "Landmarks" not in found
    assert "no interval" not in found


def test_nothing_finished_yet(tmp_path):
    _, results = plan(tmp_path)
    write_report(results.folder)
    found = Page((results.folder / "report.html").read_text("utf-8"))
    assert "PARTIAL STUDY: 0 of 18 runs" in found.text["li"]
    assert found.all("img") == []


def test_it_knows_of_which_results_it_is(tmp_path, monkeypatch):
    """One that came while the page was made is not on it, however old the page's file is."""
    study, results = plan(tmp_path, NOTHING_TO_DRAW)
    first, second = study.jobs()
    run_job(first, results.jobs)
    original = module.page

    def slow_page(*given):
        run_job(second, results.jobs)
        return original(*given)

    monkeypatch.setattr(module, "page", slow_page)
    before = results.fingerprint()
    content = write_report(results.folder).read_text("utf-8")
    assert before in content
    assert results.fingerprint() not in content
    monkeypatch.undo()
    assert results.fingerprint() in write_report(results.folder).read_text("utf-8")


def test_a_study_whose_name_is_in_another_encoding(tmp_path):
    study, _ = plan(tmp_path)
    odd = Results(tmp_path / "results/\udcfcber")
    odd.prepare(replace(study, name="\udcfcber"))
    assert "<h1>?ber</h1>" in write_report(odd.folder).read_text("utf-8")


def test_a_folder_without_results_is_refused(tmp_path):
    with pytest.raises(ResultsError, match="not a results folder"):
        write_report(tmp_path)


def test_the_command(environment, tmp_path):
    _, results = plan(tmp_path)
    code, output = run(environment, "report", results.folder)
    assert (code, output) == (0, f"written: {results.folder / 'report.html'}\n")
    code, output = run(environment, "report", tmp_path)
    assert code == 2
    assert "not a results folder" in output


CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
@pytest.mark.parametrize("width", [500, 1200])
def test_a_browser_shows_it(results, tmp_path, width):
    """Headless, without a network: the title and the first figure, on a phone and on a screen."""
    picture = tmp_path / "page.png"
    arguments = [
        "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
        "--hide-scrollbars", "--host-resolver-rules=MAP * ~NOTFOUND",
        f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={width},1400",
        f"--screenshot={picture}", (results.folder / "report.html").resolve().as_uri(),
    ]  # fmt: skip
    subprocess.run(
        [CHROMIUM, *arguments], check=True, capture_output=True, timeout=120, env={**os.environ}
    )
    seen = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    assert seen.shape[1] == width
    dark = (seen.max(axis=2) < 90).any(axis=1)
    assert dark[:150].any()  # the title
    assert (seen[0] > 250).all()
    # The colour of the first figure's lines, below the links.
    shade = np.array([round(255 * c) for c in to_rgb(style.UNORDERED[0])])
    near = np.abs(seen[300:] - shade).max(axis=2) < 24
    assert near.sum() > 100
