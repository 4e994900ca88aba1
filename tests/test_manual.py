"""The manual is true: every command and piece of code in README.md, its pages and the help runs.

Those that install do all but ask the network: pip is a stand-in that writes down what it was asked.
"""

import gzip
import itertools
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from tools import FakeSlurm, new_environment, run
from typer.main import get_command
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


NAMES = sorted(get_command(cli.app).commands)


def in_remarks():
    """Yield the commands that remarks name by their begin, such as `show ID`."""
    for words in re.findall(rf"`((?:{'|'.join(NAMES)}) [^`]+)`", README):
        if "ID" in words or "FILE" in words:
            yield f"shear-sim {words}"


def with_options():
    """Yield each command that stands alone on a line with each option that its remark names."""
    lines = re.findall(r"^    (shear-sim .*?)\s{2,}(.*)$", README, re.MULTILINE)
    for command, remark in lines:
        for option, value in re.findall(r"(--[a-z-]+)(?: (?=[a-zR])([\w/]+))?", remark):
            yield command, option, value


COMMANDS = sorted(
    {*in_blocks(README), *in_code(README), *in_code(PAGES), *in_help(), *in_remarks()}
)
OPTIONS = sorted({each for each in with_options() if each[1] not in each[0]})
VALUES = {
    "i/n": "0/2", "R": "results", "--jobs": "1", "--limit": "1", "--results": "results",
    "--colour": "pressure", "--time": "0", "--out": "some.png", "--account": "some",
    "--mem": "1000", "--max-tasks": "2",
}  # fmt: skip
INSTALL = "shear-sim --install-completion"  # for the shell that calls it, see below
# Studies in the manual whose results are there, and others: in the sandbox all are the same.
DONE, NEW = ("main", "quick", "film", "soft_tissue"), ("soft_beam", "soft_free_ring")


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


@pytest.mark.parametrize(("command", "option", "value"), OPTIONS)
def test_an_option_of_a_remark_runs(command, option, value, sandbox, tmp_path, monkeypatch):
    monkeypatch.chdir(sandbox)
    FakeSlurm(tmp_path / "slurm").on(monkeypatch)
    name, *given = here(command, sandbox)
    known = get_command(cli.app).commands[name].params
    [flag] = [each.is_flag for each in known if option in [*each.opts, *each.secondary_opts]]
    if not flag:
        given += [option, VALUES.get(value or option, value)]
    shown = CliRunner().invoke(
        cli.app, [name, *given, *([option] if flag else [])], catch_exceptions=False
    )
    assert shown.exit_code == 0, shown.output


def test_the_remarks_have_options():
    found = {option for _, option, _ in OPTIONS}
    assert found > {"--shard", "--limit", "--tensor", "--remove", "--max-tasks", "--watch"}


INSTALLS = re.findall(r"^    (python3 .*?)(?:\s{2,}.*)?$", README, re.MULTILINE)
PYTHON3 = """#!/bin/sh
case "$1 $2" in
"-m venv") exec {python} "$@" ;;
"-m pip") echo "$@" >> asked; cp {program} .venv/bin/shear-sim ;;
*) exit 64 ;;
esac
"""


@pytest.fixture
def fresh(tmp_path):
    """A fresh clone as far as installing goes, and the environment of its first shell."""
    program = tmp_path / "shear-sim"
    program.write_text(f"#!{sys.executable}\nfrom shear_sim.cli import main\nmain()\n")
    program.chmod(0o755)
    found = tmp_path / "bin/python3"
    found.parent.mkdir()
    found.write_text(PYTHON3.format(python=sys.executable, program=program))
    found.chmod(0o755)
    folder = tmp_path / "clone"
    for path, text in (
        ("configs/main.yaml", SMALL),
        ("tests/test_some.py", "def test_some():\n    assert True\n"),
    ):
        (folder / path).parent.mkdir(parents=True)
        (folder / path).write_text(text)
    env = new_environment()
    return folder, env | {"PATH": f"{found.parent}:{env['PATH']}"}


def in_shell(line, fresh):
    folder, env = fresh
    shown = subprocess.run(
        ["sh", "-e", "-c", line], cwd=folder, env=env, text=True, capture_output=True
    )
    assert shown.returncode == 0, shown.stdout + shown.stderr
    return shown.stdout


@pytest.mark.parametrize("line", INSTALLS)
def test_a_line_that_installs_runs(line, fresh):
    """From nothing: each part of it, the main study cut to four jobs, the tests to one."""
    assert line.startswith("python3 -m venv --without-pip .venv && python3 -m pip ")
    shown = in_shell(line, fresh)
    [asked] = (fresh[0] / "asked").read_text().splitlines()
    what = re.fullmatch(r"-m pip --python \.venv install -e \.(?:\[(\w+)\])?", asked)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert what
    assert what[1] in {None, *project["optional-dependencies"]}
    assert "shear-sim" in project["scripts"]
    if "shear-sim" in line:
        assert "4 of 4 jobs done" in shown
        assert (fresh[0] / "results/main/tables/curves.parquet").exists()
        assert list((fresh[0] / "results/main/figures").iterdir())
    if "pytest" in line:
        assert "1 passed" in shown


def test_the_manual_installs_the_study_the_tests_and_for_the_first_minutes():
    assert [line.rpartition("&& ")[2] for line in INSTALLS] == [
        ".venv/bin/shear-sim aggregate results/main",
        ".venv/bin/python -m pytest",
        "python3 -m pip --python .venv install -e .",
    ]


def test_the_first_ten_minutes_begin_with_all_that_they_need(fresh):
    """In their order, from a fresh clone: what stands before the first command makes it one."""
    section = README.partition("## The first ten minutes")[2].partition("\n## ")[0]
    lines = [
        re.split(r"\s{2,}", line)[0] for line in re.findall(r"^    (\S.*)$", section, re.MULTILINE)
    ]
    first = next(i for i, line in enumerate(lines) if line.startswith("shear-sim"))
    shown = in_shell(
        "\n".join([*lines[:first], "command -v shear-sim; shear-sim --version"]), fresh
    )
    assert f"{fresh[0]}/.venv/bin/shear-sim\nshear-sim " in shown


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
    if study == "quick":  # what the README says of its tables
        _, output = run(new_environment(), "aggregate", tmp_path / study, "--no-figures")
        for words in (
            "runs are flagged, and counted all the same",
            "whose mean stress drifts by over 10% of the amplitude in a period (drift_ratio)",
            "2 of 2 curves show no plateau, as their G′ is under 90% of its first value",
            "intervals of means may miss the truth more often than they say, most as they are of",
        ):
            assert words in output


@pytest.mark.parametrize(
    "path", sorted((ROOT / "configs").rglob("*.yaml")), ids=lambda path: path.stem
)
def test_a_study_file_names_its_own_commands(path):
    commands = re.findall(r"^# +shear-sim (\w+) +(\S+)", path.read_text(), re.MULTILINE)
    ours = dict.fromkeys(("aggregate", "report", "show"), f"results/{path.stem}")
    assert commands
    for command, about in commands:
        assert about == ours.get(command, path.relative_to(ROOT).as_posix())
