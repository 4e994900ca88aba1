import json
import os
import shutil
import signal
import subprocess
import sys
import warnings
from importlib.metadata import version

import pytest
from tools import here, run, write_study
from typer.testing import CliRunner

from shear_sim import cli, status
from shear_sim.results import Results
from shear_sim.tables import read_arrow, read_summary, write_arrow

HEAVY = {
    "numba",
    "numpy",
    "pandas",
    "scipy",
    "pyarrow",
    "matplotlib",
    "pydantic",
    "shear_sim.sweep",
}


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Results with 3 finished jobs and 3 that failed by physics."""
    folder = tmp_path_factory.mktemp("swept")
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    study = write_study(folder, "[none, physics]", replicates=1)
    code, output = run(env, "sweep", study, "--results", folder / "results")
    assert code == 1, output
    return folder, env, output


def test_help_loads_nothing_heavy(environment):
    code = f"import sys, shear_sim.cli; print(sorted({HEAVY!r} & sys.modules.keys()))"
    found = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True)
    assert found.stdout == b"[]\n"


def test_every_command_explains_itself_with_an_example():
    runner = CliRunner()
    names = [c.callback.__name__.replace("_", "-") for c in cli.app.registered_commands]
    running = ["sweep", "plan", "submit", "compile", "run", "status", "show", "render", "verify"]
    assert names == [*running, "aggregate", "import-legacy", "report", "accuracy", "schema"]
    for name in names:
        shown = runner.invoke(cli.app, [name, "--help"])
        assert shown.exit_code == 0
        assert f"shear-sim {name} " in shown.output


def test_the_list_of_commands_is_not_cut_short():
    shown = CliRunner().invoke(cli.app, ["--help"], terminal_width=80).output
    assert "..." not in shown.partition("Commands:")[2]


def test_the_limit_says_what_exit_code_0_means_then():
    shown = CliRunner().invoke(cli.app, ["sweep", "--help"]).output
    assert "exit code 0 then does not mean that all jobs are done" in " ".join(shown.split())


@pytest.mark.parametrize("module", ["shear_sim", "shear_sim.cli"])
def test_the_module_is_the_command(module, environment):
    command = [sys.executable, "-m", module]
    shown = subprocess.check_output([*command, "--version"], env=environment, text=True)
    assert shown == f"shear-sim {version('shear-sim')}\n"
    assert subprocess.run([*command, "plan"], env=environment, capture_output=True).returncode == 2


def test_version(environment):
    assert run(environment, "--version") == (0, f"shear-sim {version('shear-sim')}\n")


def test_a_sweep_reports_failures_and_where_to_look_next(swept):
    folder, _, output = swept
    results = folder / "results/study"
    assert "6 jobs: 6 new, 0 done, 0 failed" in output
    assert "3 of 6 jobs done (3 now" in output
    assert "(physics): the spring broke at t = 3 s: use a softer one" in output
    assert "tried again only with --retry-failed" in output
    assert f"next: shear-sim aggregate {results}" in output


def test_plan_and_dry_run_are_the_same_and_write_nothing(swept, tmp_path):
    folder, env, _ = swept
    study = folder / "study.yaml"
    code, planned = here("plan", study, "--results", tmp_path / "new")
    assert code == 0
    assert "6 jobs: 6 new" in planned
    assert run(env, "sweep", study, "--results", tmp_path / "new", "--dry-run") == (0, planned)
    assert not (tmp_path / "new").exists()


def test_plan_as_json(swept):
    folder, *_ = swept
    arguments = ("plan", folder / "study.yaml", "--results", folder / "results", "--json")
    code, output = here(*arguments)
    plan = json.loads(output)
    assert code == 0
    assert (plan["jobs"], plan["done"], plan["new"], plan["orphans"]) == (6, 3, 0, 0)
    assert plan["again"] == []
    assert {failure["kind"] for failure in plan["waiting"]} == {"physics"}
    assert plan["estimate"]["measured_jobs"] == 3
    again = json.loads(here(*arguments, "--retry-failed", "--shard", "0/2")[1])
    assert again["shard"] == [0, 2]
    assert again["jobs"] == 3
    assert again["estimate"]["cpu_s"] > 0
    assert again["estimate"]["disk_bytes"] > 1000 * len(again["again"])


def test_status_for_people_and_for_scripts(swept):
    folder, *_ = swept
    results = folder / "results/study"
    code, output = here("status", results)
    assert code == 0
    assert "3 of 6 jobs done, 3 failed, 0 missing" in output
    assert "the spring broke" in output
    code, output = here("status", folder / "study.yaml", "--results", folder / "results", "--json")
    status = json.loads(output)
    assert (status["planned"], status["done"], status["missing"]) == (6, 3, 0)
    assert len(status["failed"]) == 3
    assert status["cpu_s"] > 0


def test_results_that_are_all_damaged_are_said_and_stop_nothing(swept, tmp_path):
    folder, *_ = swept
    results = Results(tmp_path / "results/study")
    shutil.copytree(folder / "results/study", results.folder)
    for path in results.jobs.iterdir():
        path.write_bytes(path.read_bytes()[:-5])
    results.index_file.unlink(missing_ok=True)
    study = (folder / "study.yaml", "--results", tmp_path / "results")
    for command, code in (("plan", 0), ("sweep", 1), ("status", 0)):
        ended, output = here(command, *study)
        assert ended == code, output
        assert "warning: 3 damaged result file(s) left out" in output
        assert f"`shear-sim verify {results.folder} --remove` sets them aside, then" in output
        assert "3 done" in output or "3 of 6 jobs done" in output
    assert json.loads(here("status", *study, "--json")[1].split("\n", 1)[1])["cpu_s"] == 0


def test_a_damaged_result_is_said_once(swept, tmp_path):
    folder, *_ = swept
    results = Results(tmp_path / "study")
    shutil.copytree(folder / "results/study", results.folder)
    path = results.job_file(min(results.finished()))
    path.write_bytes(path.read_bytes()[:-5])
    code, output = here("report", results.folder)
    assert (code, output.count("damaged result")) == (0, 1), output


def test_show_a_result_and_a_failure(swept):
    folder, *_ = swept
    results = Results(folder / "results/study")
    job = min(results.finished())
    root = ("--results", folder / "results")
    code, output = here("show", job[:9], *root)
    assert code == 0
    assert "shear.strain_amplitude" in output
    code, output = here("show", results.job_file(job), "--json")
    assert json.loads(output) == read_summary(results.job_file(job))
    failed = min(results.failures())
    code, output = here("show", failed, *root)
    assert code == 0
    assert "the spring broke" in output


def test_the_jobs_of_a_study_are_listed_with_what_varies(swept, tmp_path):
    folder, env, _ = swept
    results = folder / "results/study"
    code, output = here("show", results)
    assert code == 0
    names, *rows = [line.split() for line in output.splitlines()]
    assert names == ["job", "scene", "model.fault", "shear.strain_amplitude", "replicate", "state"]
    assert [row[1:] for row in rows] == [
        ["base", fault, amplitude, "0", "done" if fault == "none" else "failed"]
        for fault in ("none", "physics") for amplitude in ("0.01", "0.1", "1")
    ]  # fmt: skip
    listed = json.loads(here("show", results, "--json")[1])
    assert [job["job"] for job in listed] == [row[0] for row in rows]
    assert {job["state"] for job in listed} == {"done", "failed"}
    run(env, "sweep", folder / "study.yaml", "--results", tmp_path, "--limit", "0")
    assert here("show", tmp_path / "study")[1].count("missing") == 6
    code, output = here("show", "abc", "--results", folder / "results")
    assert code == 2
    assert "`shear-sim show results/<study>` lists the jobs" in output


def test_a_folder_is_no_study_file(swept):
    folder, env, _ = swept
    code, output = run(env, "sweep", folder)
    assert code == 2
    assert f"{folder}: a folder: give the study file" in output


def test_run_one_job_and_repeat_it(swept, tmp_path):
    folder, *_ = swept
    job = min(Results(folder / "results/study").finished())
    root = ("--results", tmp_path)
    code, output = here("run", folder / "study.yaml", "--job", job[:9], *root)
    path = tmp_path / f"study/jobs/{job}.parquet"
    assert code == 0
    assert f"done: {path}" in output
    code, output = here("run", path, *root)
    assert code == 0
    assert f"the same bits as {path}" in output
    assert (tmp_path / f"repeated/jobs/{job}.parquet").exists()


def test_a_repeat_that_differs_says_where(swept, tmp_path):
    from shear_sim.tables import read_table, write_table

    folder, *_ = swept
    results = Results(folder / "results/study")
    job = min(results.finished())
    columns, summary = read_table(results.job_file(job))
    columns = {**columns, "strain": columns["strain"] * (1 + 1e-15)}
    fields = [(name, "1", "") for name in columns]
    write_table(tmp_path / f"{job}.parquet", columns, fields, summary)
    code, output = here("run", tmp_path / f"{job}.parquet", "--results", tmp_path)
    assert code == 1
    assert "differs: column strain" in output
    assert "not the same bits" in output


@pytest.mark.parametrize("command", ["run", "show"])
def test_other_tables_are_no_results_of_jobs(command, swept):
    folder, *_ = swept
    results = folder / "results/study"
    here("aggregate", results, "--no-figures")
    for name in ("index.parquet", "plan.parquet", "tables/runs.parquet"):
        code, output = here(command, results / name, "--results", folder)
        assert code == 2
        assert f"shear-sim: {results / name}: not a result file of a job" in output


def test_tables_that_cannot_be_written_are_shown_all_the_same(swept, tmp_path):
    folder, *_ = swept
    results = tmp_path / "study"
    shutil.copytree(folder / "results/study", results, ignore=shutil.ignore_patterns("tables"))
    (results / "tables").write_text("in the way of the folder, for root too")
    code, output = here("aggregate", results)
    assert code == 2
    assert "PARTIAL STUDY: 3 of 6 runs" in output
    *_, last = output.splitlines()
    assert f"{results}: the tables and figures cannot be written" in last
    assert "aggregate the copy" in last


def test_run_records_a_failure(swept, tmp_path):
    folder, *_ = swept
    failed = min(Results(folder / "results/study").failures())
    arguments = ("run", folder / "study.yaml", "--job", failed, "--results", tmp_path)
    for tries in (1, 2, 3):
        code, output = here(*arguments)
        assert code == 1
        assert f"failed: job {failed} (physics): the spring broke" in output
        recorded = Results(tmp_path / "study").failures()
        assert {job: failure.tries for job, failure in recorded.items()} == {failed: tries}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sweep", "missing.yaml"], "missing.yaml"),
        (["sweep", "bad.yaml"], "strain_amplitude"),
        (["plan", "study.yaml", "--shard", "4/4"], "starts from 0 too: --array=0-3"),
        (["plan", "study.yaml", "--shard", "one"], "i/n with i from 0 to n - 1"),
        (["plan", "study.yaml", "--jobs", "0"], "--jobs"),
        (["run", "study.yaml"], "--job ID is missing"),
        (["run", "study.yaml", "--job", "zz"], "0 jobs of study.yaml"),
        (["run", "study.yaml", "--job", ""], "6 jobs of study.yaml"),
        (["run", "missing.parquet"], "no such file"),
        (["status", "."], "not a results folder"),
        (["status", "missing"], "missing"),
        (["show", "0123"], "no such file"),
        (["show", "bad.yaml"], "cannot be read as a table"),
        (["aggregate", "."], "not a results folder"),
        (["aggregate", ".", "--tensor", "surface"], "'periodic', 'internal', 'external'"),
        (["swep", "study.yaml"], "swep"),
        (["sweep", "study.yaml", "--results", "x" * 300], "File name too long: give a shorter"),
        (["status", "x" * 300], "File name too long: give a shorter"),
        (["show", "x" * 300], "File name too long: give a shorter"),
    ],
)
def test_bad_input_is_explained_with_exit_code_2(arguments, message, tmp_path, monkeypatch, capsys):
    (tmp_path / "bad.yaml").write_text("shear: {strain_amplitude: -1}\n")
    write_study(tmp_path, "[none, physics]", replicates=1)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["shear-sim", *arguments])
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit) as stopped:
        cli.main()
    shown = capsys.readouterr().err
    assert stopped.value.code == 2
    assert message in shown
    assert "Traceback" not in shown
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.yaml", "study.yaml"]


@pytest.mark.parametrize("value", ["0", "-1", "abc", "2(x3)"])
def test_a_number_of_cores_that_is_none_is_bad_input(value, monkeypatch, tmp_path):
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", value)
    study = write_study(tmp_path)
    code, output = here("plan", study)
    assert code == 2
    assert f"shear-sim: SLURM_CPUS_PER_TASK={value}: must be a whole number above 0" in output
    assert here("plan", study, "--jobs", "2")[0] == 0


SIGNALLED = """
import os, sys

class Finder:
    def find_spec(self, name, *_):
        if name == "pydantic":
            os.kill(os.getpid(), {number})

sys.meta_path.insert(0, Finder())
from shear_sim.cli import main; main()
"""


@pytest.mark.parametrize("command", ["sweep", "plan"])
@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), (signal.SIGTERM, 75), (signal.SIGUSR1, 75), (signal.SIGHUP, 75)],
)
def test_a_signal_while_libraries_load_has_its_exit_code(number, code, command, environment):
    arguments = [sys.executable, "-c", SIGNALLED.format(number=int(number)), command, "x.yaml"]
    ended = subprocess.run(arguments, env=environment, capture_output=True, text=True)
    assert ended.returncode == code
    assert ended.stderr == ""


def test_nohup_is_obeyed(environment):
    code = SIGNALLED.format(number=int(signal.SIGHUP))
    code = f"import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN){code}"
    arguments = [sys.executable, "-c", code, "plan", "x.yaml"]
    assert subprocess.run(arguments, env=environment, capture_output=True).returncode == 2


def test_debug_shows_the_traceback(environment, tmp_path):
    code, output = run(environment, "--debug", "plan", tmp_path / "missing.yaml")
    assert code != 0
    assert "Traceback" in output


def test_verify_names_what_is_damaged_and_sets_it_aside_when_told(swept, tmp_path):
    folder, env, _ = swept
    results = Results(tmp_path / "results/study")
    shutil.copytree(folder / "results/study", results.folder)
    assert here("verify", results.folder) == (0, "3 results, 0 damaged\n")
    path = results.job_file(min(results.finished()))
    content = bytearray(path.read_bytes())
    content[200] ^= 1
    path.write_bytes(content)
    code, output = here("verify", results.folder)
    assert code == 1
    assert f"damaged: {path}: damaged: its checksum is wrong\n" in output
    assert path.exists()
    what_to_do = f"`shear-sim verify {results.folder} --remove` sets it aside, then"
    for command in ("show", "run", "render"):
        code, shown = here(command, path, "--results", tmp_path)
        assert (code, what_to_do in shown) == (2, True), shown
    code, output = here("verify", results.folder, "--remove")
    assert code == 1
    assert "3 results, 1 damaged\nnext: shear-sim sweep STUDY.yaml\n" in output
    assert (results.folder / "damaged" / path.name).read_bytes() == content
    code, output = run(env, "sweep", folder / "study.yaml", "--results", tmp_path / "results")
    assert "6 jobs: 1 new, 2 done, 3 failed" in output
    assert here("verify", results.folder)[0] == 0


def test_results_of_a_newer_version_are_refused(swept, tmp_path):
    folder, *_ = swept
    results = Results(tmp_path / "results/study")
    shutil.copytree(folder / "results/study", results.folder)
    table, summary = results.plan()
    write_arrow(results.plan_file, table, {**summary, "format": 2})
    job = results.job_file(min(results.finished()))
    write_arrow(job, read_arrow(job), {**read_summary(job), "format": 2})
    study = (folder / "study.yaml", "--results", tmp_path / "results")
    for command in (
        ("sweep", *study),
        ("status", *study),
        ("aggregate", results.folder),
        ("show", job),
        ("run", job, "--results", tmp_path),
    ):
        code, output = here(*command)
        assert code == 2, output
        assert "made by a newer version of shear-sim (format 2; this one reads 1)" in output


def test_watching_ends_when_nothing_is_missing(swept):
    folder, *_ = swept
    code, output = here("status", folder / "results/study", "--watch")
    assert code == 0
    assert output.count("3 of 6 jobs done, 3 failed, 0 missing") == 1


def test_watching_goes_on_until_there_is_a_plan(swept, tmp_path, monkeypatch):
    """As where somebody watches before the first task has written one."""
    results = Results(shutil.copytree(swept[0] / "results/study", tmp_path / "study"))
    plan = results.plan_file.rename(tmp_path / "plan")
    monkeypatch.setattr(status, "WATCH_SECONDS", 0.0)
    shown = []

    def show(text):
        shown.append(text)
        if len(shown) == 3:
            plan.rename(results.plan_file)
        assert len(shown) < 10

    status.watch(results, show)
    assert ["of ? jobs" in text for text in shown] == [True] * 3 + [False]


def test_kernels_can_be_compiled_ahead(tmp_path, environment):
    study = write_study(tmp_path, compiled=True)
    environment["SHEAR_SIM_CACHE"] = str(tmp_path / "cache")
    code, output = run(environment, "compile", study)
    assert code == 0
    assert "compiling the kernels" in output
    assert f"compiled code is in {tmp_path / 'cache'}" in output
    assert "compiling" not in run(environment, "compile", study)[1]


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["stat"], ["status"]),
        (["render", "--fi"], ["--film"]),
        (["show", "JOB"], ["JOB"]),
        (["render", ""], ["0123456789abcdef"]),  # of those that keep snapshots
        (["schema", "mi"], ["microgel"]),
        (["schema", "--json", "s"], ["soft_particle"]),
        (["sweep", "stu"], []),  # then bash completes the names of files
    ],
)
def test_the_shell_completes(words, found, swept, tmp_path):
    """Commands, options and ids of jobs, by the script that --show-completion prints."""
    folder, env, _ = swept
    job = min(Results(folder / "results/study").finished())
    words = [word.replace("JOB", job[:6]) for word in words]
    kept = folder / "results/study/snapshots/0123456789abcdef.gsd"
    kept.parent.mkdir(exist_ok=True)
    kept.touch()
    command = tmp_path / "shear-sim"
    command.write_text(
        f"#!{sys.executable}\nimport kelvin_voigt\nfrom shear_sim.cli import main\nmain()\n"
    )
    command.chmod(0o755)
    typed = " ".join(["shear-sim", *words[:-1], words[-1] or "''"])
    script = f"""
eval "$({command} --show-completion bash)"
complete -p shear-sim
COMP_WORDS=({typed}); COMP_CWORD={len(words)}
_shear_sim_completion {command}
echo "${{COMPREPLY[@]}}"
"""
    shown = subprocess.run(
        ["bash", "-c", script], cwd=folder, env=env, capture_output=True, text=True
    )
    shutil.rmtree(kept.parent)
    registered, completed = shown.stdout.splitlines()
    assert registered == "complete -o default -F _shear_sim_completion shear-sim", shown.stderr
    assert completed.split() == [job if word == "JOB" else word for word in found]
