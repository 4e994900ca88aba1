"""The manual is true: every command and piece of code in README.md, its pages and the help runs."""

import gzip
import itertools
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tools import FakeSlurm, new_environment, run
from typer.testing import CliRunner

from shear_sim import cli
from shear_sim.results import Results
from shear_sim.study import load_study

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
PAGES = "\n".join(path.read_text() for path in sorted((ROOT / "analysis").rglob("*.md")))
SMALL = """
packing: {discs: 12, packing_fraction: 1.5}
model: {friction: 0, links: {cut: bulk}}
shear: {pre_periods: 0, periods: 2, post_periods: 0}
record: {snapshots: 2}
sweep: {grid: {shear.strain_amplitude: [0.01, 0.02]}}
replicates: 2
seed: 1
"""  # in place of the studies that the manual speaks of: the same files, in a second
EXAMPLE_ID = "3f9c21d07be4a815"


def in_blocks(text):
    """Return the commands that stand alone on an indented line, without the remark after them."""
    lines = re.findall(r"^    (shear-sim .*)$", text, re.MULTILINE)
    return [re.split(r"\s{2,}", line)[0] for line in lines]


def in_help():
    for command in cli.app.registered_commands:
        text = " ".join(command.callback.__doc__.split())
        examples = re.search(r"Examples?: (.*)", text)
        assert examples, command.callback.__name__
        yield from re.split(r"; (?=shear-sim)", examples[1])


def in_code(text):
    """Return whole commands in backticks (names of commands alone are words)."""
    found = re.findall(r"`(shear-sim (?:--[a-z-]+|[a-z-]+ [^`]+))`", text)
    return [each for each in found if "COMMAND" not in each]


COMMANDS = sorted({*in_blocks(README), *in_code(README), *in_code(PAGES), *in_help()})
INSTALL = "shear-sim --install-completion"  # for the shell that calls it, see below
# Studies in the manual whose results are there, and others: in the sandbox all are the same.
DONE, NEW = ("main", "quick", "film"), ("soft_beam", "soft_free_ring", "soft_tissue")


def different(commands):
    """Return those commands that do not differ by the name of a study alone."""
    for first, *others in (DONE, NEW):
        names = rf"(?<=configs/|results/)({'|'.join(others)})\b"
        commands = [re.sub(names, first, command) for command in commands]
    return sorted(set(commands))


def code_blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def sandbox(tmp_path_factory):
    """A folder with small studies of the names in the manual, the main one run, and old runs."""
    folder = tmp_path_factory.mktemp("manual")
    (folder / "configs").mkdir()
    for name in (*DONE, *NEW):
        (folder / f"configs/{name}.yaml").write_text(SMALL)
    study = folder / "configs/main.yaml"
    code, output = run(new_environment(), "sweep", study, "--results", folder / "results")
    assert code == 0, output
    for name in DONE[1:]:
        shutil.copytree(folder / "results/main", folder / f"results/{name}")
    for name in ("old_runs", "OLD"):
        (folder / name).mkdir()
        with gzip.open(ROOT / "tests/data/legacy_uncrosslinked_N60.txt.gz") as old:
            (folder / name / "run.txt").write_bytes(old.read())
    shutil.copytree(ROOT / "slurm", folder / "slurm")
    return folder


def here(command, folder):
    """Return the arguments of a command of the manual, about what is in the sandbox."""
    job = min(Results(folder / "results/main").finished())
    for word, meant in (
        (EXAMPLE_ID, job), (EXAMPLE_ID[:6], job[:12]), (" ID", f" {job}"),
        ("FILE.parquet", f"results/main/jobs/{job}.parquet"), ("FILES…", "OLD/*.txt"),
    ):  # fmt: skip
        command = command.replace(word, meant)
    given = shlex.split(command.partition(" > ")[0])[1:]
    wild = ([str(path.relative_to(folder)) for path in folder.glob(each)] for each in given)
    return list(
        itertools.chain(*(w if "*" in g else [g] for g, w in zip(given, wild, strict=True)))
    )


@pytest.mark.parametrize("command", different(each for each in COMMANDS if each != INSTALL))
def test_a_command_of_the_manual_runs(command, sandbox, tmp_path, monkeypatch):
    monkeypatch.chdir(sandbox)
    shutil.rmtree("results/old", ignore_errors=True)  # which an import makes
    FakeSlurm(tmp_path / "slurm").on(monkeypatch)
    if "results/old" in command and "import-legacy" not in command:
        old = ["import-legacy", "OLD/run.txt", "--out", "results/old"]
        assert CliRunner().invoke(cli.app, old, catch_exceptions=False).exit_code == 0
    shown = CliRunner().invoke(cli.app, here(command, sandbox), catch_exceptions=False)
    assert shown.exit_code == 0, shown.output


def test_the_completion_of_the_manual_is_installed(tmp_path):
    """In the files of the shell that calls it; whether it completes is another test."""
    assert INSTALL in COMMANDS
    program = tmp_path / "shear-sim"
    program.write_text(f"#!{sys.executable}\nfrom shear_sim.cli import main\nmain()\n")
    program.chmod(0o755)
    env = new_environment() | {"HOME": str(tmp_path)}
    script = f"{INSTALL.replace('shear-sim', str(program))}; exit $?"  # the shell stays the parent
    subprocess.run(["bash", "-c", script], env=env, check=True, capture_output=True)
    assert "shear-sim" in (tmp_path / ".bashrc").read_text()


def test_the_manual_speaks_of_every_command():
    named = {command.split()[1] for command in in_blocks(README)}
    callbacks = [c.callback.__name__.replace("_", "-") for c in cli.app.registered_commands]
    assert named == set(callbacks)


@pytest.mark.parametrize("block", code_blocks("python"))
def test_python_of_the_readme_runs(block, sandbox, monkeypatch):
    monkeypatch.chdir(sandbox)
    exec(compile(block, "README.md", "exec"), {})  # noqa: S102 - our own README


@pytest.mark.parametrize("block", code_blocks("yaml"))
def test_a_study_of_the_readme_is_planned(block, tmp_path):
    study = tmp_path / "study.yaml"
    study.write_text(block if "seed:" in block else block + "seed: 1\n")
    assert load_study(study).jobs()


@pytest.mark.parametrize(("study", "jobs"), [("quick", 40), ("film", 2)])
def test_the_first_studies_run_as_they_are(study, jobs, tmp_path):
    file = ROOT / f"configs/{study}.yaml"
    code, output = run(new_environment(), "sweep", file, "--results", tmp_path)
    assert (code, f"{jobs} of {jobs} jobs done" in output) == (0, True), output


@pytest.mark.parametrize(
    "path", sorted((ROOT / "configs").rglob("*.yaml")), ids=lambda path: path.stem
)
def test_a_study_file_names_its_own_commands(path):
    commands = re.findall(r"^# +shear-sim (\w+) +(\S+)", path.read_text(), re.MULTILINE)
    ours = dict.fromkeys(("aggregate", "report", "show"), f"results/{path.stem}")
    assert commands
    for command, about in commands:
        assert about == ours.get(command, path.relative_to(ROOT).as_posix())
