"""What is submitted and what is asked of Slurm, with stand-ins for its commands."""

import json
import os
import re
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tools import FakeSlurm, run, write_study

from shear_sim import slurm
from shear_sim.division import divide, file_name, write_division
from shear_sim.plan import PlanError, make_plan
from shear_sim.results import Failure, Results, ResultsError
from shear_sim.slurm import SlurmError, Submission, Task, index_list
from shear_sim.status import describe_status, read_status
from shear_sim.study import load_study
from shear_sim.submit import Limits, describe, held, lay_out, submit


@pytest.fixture
def fake(tmp_path, monkeypatch):
    made = FakeSlurm(tmp_path / "slurm")
    made.on(monkeypatch)
    return made


@pytest.fixture
def plan(tmp_path):
    """12 jobs of three points that cost 100, 200 and 600 s; nothing is done."""
    study = load_study(write_study(tmp_path))
    planned = make_plan(study, Results(tmp_path / "results/study"))
    costs = {0.01: 100.0, 0.1: 200.0, 1.0: 600.0}
    for job in planned.run:
        planned.wall_s.add(planned.points[job.id], costs[job.point.shear.strain_amplitude])
    return planned


def flat(shares):
    return [job for share in shares for job in share]


def loads(plan, layout):
    """Return what each task will take, from the jobs themselves."""
    return [sum(plan.wall_s.mean(plan.points[job]) for job in share) for share in layout.shares]


@pytest.mark.parametrize("limits", [Limits(), Limits(minutes=25), Limits(minutes=120, max_tasks=3)])
def test_tasks_are_as_long_as_they_should_be(plan, limits):
    layout = lay_out(plan, limits, set())
    longest, shortest = max(loads(plan, layout)), min(loads(plan, layout))
    assert layout.seconds == pytest.approx(longest)
    assert sorted(flat(layout.shares)) == [job.id for job in plan.study.jobs()]
    assert layout.minutes <= (limits.minutes or 1440)
    assert 60 * layout.minutes >= longest + 120  # room to start, and for the warning
    assert len(layout.shares) <= (limits.max_tasks or 12)
    assert shortest >= 600  # no task of seconds


@pytest.mark.parametrize(
    ("usable", "costs", "tasks", "shortest"),
    [
        (1000.0, {1000.0: 40, 1.0: 360}, 40, 1000),
        (1800.0, {1000.0: 40, 1.0: 360}, 22, 1090),
        (1000.0, {900.0: 362, 1.0: 100}, 362, 900),
        (1000.0, {1500.0: 40, 1.0: 1}, 40, 1500),
        (180.0, {10.0: 400}, 22, 180),
        (1000.0, {1000.0: 2, 1.0: 2000}, 4, 1000),
        (1000.0, {36000.0: 1, 10.0: 400}, 5, 1000),
    ],
)
def test_tasks_are_not_short_where_costs_differ(usable, costs, tasks, shortest):
    jobs = [cost for cost, count in costs.items() for _ in range(count)]
    shares = divide({f"{k:05}": cost for k, cost in enumerate(jobs)}, 1000, usable)
    times = [sum(jobs[int(job)] for job in share) for share in shares]
    assert len(shares) == tasks
    assert min(times) >= shortest
    for share, takes in zip(shares, times, strict=True):
        assert takes <= 1.25 * max(usable, *(jobs[int(job)] for job in share))


@given(
    cost=st.lists(st.floats(0.01, 3000), min_size=1, max_size=60),
    seconds=st.floats(60, 1800),
)
def test_every_share_is_long_enough_and_none_too_long(cost, seconds):
    """Unless it is the only one, a share takes at least a quarter of what is aimed at."""
    shares = divide(dict(zip(map(str, range(len(cost))), cost, strict=True)), 1000, seconds)
    times = [sum(cost[int(job)] for job in share) for share in shares]
    assert sorted(int(job) for share in shares for job in share) == list(range(len(cost)))
    for share, takes in zip(shares, times, strict=True):
        assert takes <= 1.25 * max(seconds, *(cost[int(job)] for job in share)) + 1e-6
    assert len(times) == 1 or min(times) >= 0.249 * seconds


def test_one_short_study_is_one_task(plan):
    plan.wall_s._sum = {key: value / 1000 for key, value in plan.wall_s._sum.items()}
    layout = lay_out(plan, Limits(), set())
    assert (len(layout.shares), layout.minutes) == (1, 10)


@pytest.mark.parametrize("minutes", [5, 6, 10, 20, 60])
def test_tasks_end_before_the_warning(plan, minutes):
    """Also where they have to compile first, for half a minute."""
    plan.wall_s._sum = {key: value * minutes / 100 for key, value in plan.wall_s._sum.items()}
    layout = lay_out(plan, Limits(minutes=minutes), set())
    assert max(loads(plan, layout)) <= 60 * minutes - 120 - 30


@pytest.mark.parametrize("minutes", [1, 2, 3, 4])
def test_a_limit_that_the_warning_takes_up_is_refused(plan, fake, minutes):
    with pytest.raises(PlanError, match=f"--time {minutes}: must be at least 5 minutes"):
        submit(plan, Limits(minutes=minutes, max_tasks=3), print)
    assert fake.calls("sbatch") == []


def test_a_job_longer_than_the_limit_is_submitted_all_the_same(plan, fake, capsys):
    plan.wall_s._sum = {key: value * 1000 for key, value in plan.wall_s._sum.items()}
    layout = lay_out(plan, Limits(minutes=60), set())
    assert layout.minutes == 60
    assert len(layout.shares) <= 12
    submit(plan, Limits(minutes=60), print)
    assert "longer than the limit: tasks will be requeued and go on" in capsys.readouterr().out


def test_without_a_measured_job_the_user_must_say(tmp_path):
    study = load_study(write_study(tmp_path))
    planned = make_plan(study, Results(tmp_path / "results/study"))
    for limits in (Limits(), Limits(minutes=30), Limits(max_tasks=4)):
        with pytest.raises(PlanError, match="run a few first"):
            lay_out(planned, limits, set())
    layout = lay_out(planned, Limits(minutes=30, max_tasks=5), set())
    assert ([len(share) for share in layout.shares], layout.minutes) == ([3, 3, 2, 2, 2], 30)
    assert layout.seconds is None


def test_arrays_stay_below_the_largest_index_and_cover_every_task(plan, fake):
    lines = []
    numbers = submit(plan, Limits(minutes=10), lines.append)
    scripts = [(fake.folder / f"script-{n}").read_text() for n in (1, 2, 3)]
    covered = []
    for script in scripts[:2]:
        [indices] = re.findall(r"--array=(\S+)", script)
        first, _, last = indices.partition("-")
        assert int(last or first) < 4
        [(offset, count)] = re.findall(
            r'--shard "\$(?:\(\()?SLURM_ARRAY_TASK_ID(?: \+ (\d+)\)\))?/(\d+)"', script
        )
        assert count == "7"
        covered += [int(offset or 0) + i for i in range(int(first), int(last or first) + 1)]
    assert sorted(covered) == list(range(7))
    assert numbers == [101, 102, 103]
    assert "#SBATCH --dependency=afterany:101:102" in scripts[2]
    records, _ = slurm.submissions(plan.results)
    assert [(each.job, each.kind) for each in records] == [
        (101, "array"), (102, "array"), (103, "aggregation"),
    ]  # fmt: skip
    assert all(str(number) in " ".join(lines) for number in numbers)


def test_every_script_leaves_the_warning_to_the_program(plan, fake):
    submit(plan, Limits(partition="long", account="a b"), print)
    script = (fake.folder / "script-1").read_text()
    assert re.search(
        r"^exec \S*python\S* -m shear_sim sweep /.*/study.yaml --results /", script, re.MULTILINE
    )
    assert "#SBATCH --signal=B:USR1@120" in script
    assert "#SBATCH --requeue" in script
    assert "#SBATCH --partition=long" in script
    assert "#SBATCH --account='a b'" in script
    assert "#SBATCH --open-mode=append" in script  # the log of a requeued task is kept
    submit(plan, Limits(minutes=30), print)
    assert "#SBATCH --time=30\n" in (fake.folder / "script-4").read_text()


def test_a_task_has_the_cores_of_its_job(plan, fake):
    """Of the job that uses most, whatever the study asks for; the report needs one."""
    run = [replace(job, threads=1 + n % 3) for n, job in enumerate(plan.run)]
    asked = replace(plan.study, threads=64)
    submit(replace(plan, study=asked, run=run), Limits(minutes=600), print)
    scripts = [path.read_text() for path in fake.folder.glob("script-*")]
    cores = {
        "--array=" in script: re.findall(r"#SBATCH --cpus-per-task=(\d+)\n", script)
        for script in scripts
    }
    assert cores == {True: ["3"], False: ["1"]}


def with_threads(plan, **threads):
    """Return the plan with those jobs only whose amplitudes are named, of so many threads each."""
    names = {0.01: "small", 0.1: "medium", 1.0: "large"}
    named = [(job, names[job.point.shear.strain_amplitude]) for job in plan.run]
    run = [replace(job, threads=threads[name]) for job, name in named if name in threads]
    return replace(plan, run=run)


def test_a_task_runs_small_jobs_at_once(plan):
    """On 4 cores one job of 4 threads, of 600 s, or four jobs of 1 thread."""
    planned = replace(with_threads(plan, small=1, medium=1, large=4), memory_mb=400.0)
    layout = lay_out(planned, Limits(max_tasks=1), set())
    assert layout.seconds == pytest.approx(4 * (600 + 200 / 4 + 100 / 4))
    assert (layout.cores, layout.memory_mb) == (4, 3 * 4 * 400)
    assert "4 core(s) and 4800 MB each" in describe(layout, 1)
    large = {job.id for job in planned.run if job.threads == 4}
    rest = lay_out(planned, Limits(), large)
    assert (rest.cores, rest.memory_mb) == (1, 3 * 400)


def test_a_task_is_as_long_as_its_longest_job(plan):
    """However many cores are beside the one that it uses."""
    planned = with_threads(plan, small=4, large=1)
    run = sorted(planned.run, key=lambda job: job.threads)
    layout = lay_out(replace(planned, run=[run[0], run[-1]]), Limits(), set())
    assert (layout.cores, len(layout.shares), layout.seconds) == (4, 1, 600)


def test_no_warning_comes_before_the_program_is_ready_for_it(plan, fake):
    """Slurm may send it a minute early; the program takes less than a second to be ready."""
    submit(plan, Limits(minutes=5), print)
    script = (fake.folder / "script-1").read_text()
    [limit] = re.findall(r"--time=(\d+)\n", script)
    [warning] = re.findall(r"--signal=B:USR1@(\d+)\n", script)
    assert 60 * int(limit) - int(warning) - 60 >= 120


def test_a_dry_run_submits_and_writes_nothing(plan, fake):
    lines = []
    assert submit(plan, Limits(), lines.append, dry_run=True) == []
    assert fake.calls("sbatch") == []
    assert not plan.results.folder.exists()
    text = "\n".join(lines)
    assert text.count("#!/bin/bash") == 2
    assert "afterany" in text


def again(plan, file=None):
    """Return the plan made anew, with the same costs."""
    study = plan.study if file is None else load_study(file)
    planned = make_plan(study, plan.results, measure=False)
    for job in planned.run:
        planned.wall_s.add(planned.points[job.id], 100.0)
    return planned


def jobs_of(fake, number):
    """Return the jobs of each task of a script, as the sweeps that it starts will plan them."""
    script = (fake.folder / f"script-{number}").read_text()
    [(study, root, division, count)] = re.findall(
        r"sweep (\S+) --results (\S+) --division (\S+) --shard .*/(\d+)\"", script
    )
    study = load_study(study)
    return [
        [
            job.id
            for job in make_plan(
                study,
                Results(Path(root) / "study"),
                shard=(k, int(count)),
                division=Path(division),
                measure=False,
            ).run
        ]
        for k in range(int(count))
    ]


def test_only_what_is_missing_and_not_queued_is_submitted_again(plan, fake):
    limits = Limits(minutes=25, max_tasks=4)
    submit(plan, limits, print)
    tasks = jobs_of(fake, 1)
    assert sorted(flat(tasks)) == [job.id for job in plan.run]
    alive = ("101|1|RUNNING|None", "101|3|PENDING|Resources", "102|N/A|PENDING|Dependency")
    fake.answers("squeue", "; ".join(f"echo '{line}'" for line in alive))
    for job in tasks[0]:  # all are done; task 2 was lost
        plan.results.job_file(job).write_bytes(b"")
    lines = []
    assert submit(again(plan), limits, lines.append) == [103, 104]
    assert sorted(flat(jobs_of(fake, 3))) == sorted(tasks[2])
    assert "afterany:101:103" in (fake.folder / "script-4").read_text()
    assert f"keep their {len(tasks[1] + tasks[3])} jobs" in lines[0]
    alive = (*alive[:2], "103|0|PENDING|Priority", "104|N/A|PENDING|Dependency")
    fake.answers("squeue", "; ".join(f"echo '{line}'" for line in alive))
    assert submit(again(plan), limits, lines.append) == []
    assert lines[-1] == "nothing to submit"


def test_new_jobs_of_an_edited_study_are_no_affair_of_running_tasks(plan, fake, tmp_path):
    """Tasks keep the jobs they were submitted with, at every run, as far as the study has them."""
    limits = Limits(minutes=60, max_tasks=2)
    submit(plan, limits, print)
    old = jobs_of(fake, 1)
    queue = ("101|0|RUNNING|None", "101|1|PENDING|Priority", "102|N/A|PENDING|Dependency")
    fake.answers("squeue", "; ".join(f"echo '{line}'" for line in queue))
    more = again(plan, write_study(tmp_path, replicates=6))
    assert submit(more, limits, print) == [103, 104]
    assert jobs_of(fake, 1) == old
    assert sorted(flat(jobs_of(fake, 3) + old)) == [job.id for job in more.study.jobs()]
    assert len(flat(jobs_of(fake, 3))) == 6
    fewer = again(plan, write_study(tmp_path, replicates=1))
    assert submit(fewer, limits, print) == []
    kept = {job.id for job in fewer.study.jobs()}
    assert jobs_of(fake, 1) == [[job for job in task if job in kept] for task in old]


def test_a_division_that_does_not_fit_is_refused(plan, fake, tmp_path):
    submit(plan, Limits(minutes=60, max_tasks=2), print)
    [path] = plan.results.submissions.glob("*.txt")
    with pytest.raises(PlanError, match="2 shares, one a line, but --shard is 0/3"):
        make_plan(plan.study, plan.results, shard=(0, 3), division=path)
    whole = path.read_bytes()
    for damaged in (whole[:-6], whole.replace(b"a", b"b", 1), b"a b\nc d\n"):
        path.write_bytes(damaged)
        with pytest.raises(PlanError, match=rf"{path}: cannot be read \(damaged"):
            make_plan(plan.study, plan.results, shard=(0, 2), division=path)
    path.unlink()
    with pytest.raises(PlanError, match=f"{path}: cannot be read"):
        make_plan(plan.study, plan.results, shard=(0, 2), division=path)
    fake.answers("squeue", "echo '101|0|RUNNING|None'")
    with pytest.raises(SlurmError, match=f"{path}: cannot be read"):
        submit(plan, Limits(minutes=60, max_tasks=2), print)


def test_an_unknown_queue_is_no_empty_queue(plan, fake):
    submit(plan, Limits(), print)
    fake.answers("squeue", "exit 1")
    with pytest.raises(SlurmError, match="squeue does not answer"):
        submit(plan, Limits(), print)
    assert len(fake.calls("sbatch")) == 2


def test_a_refusal_says_what_is_queued_already(plan, fake):
    fake.answers(
        "sbatch",
        f"[ $(wc -l < {fake.folder}/sbatch.calls) = 1 ] && echo 7 || "
        "{ echo 'sbatch: error: Invalid qos' >&2; exit 1; }",
    )
    with pytest.raises(SlurmError, match="Invalid qos; queued: 7; the same command again"):
        submit(plan, Limits(minutes=10, max_tasks=11), print)
    [kept], _ = slurm.submissions(plan.results)
    assert (kept.job, kept.tasks) == (7, (0, 1, 2, 3))


def test_without_a_place_for_its_number_nothing_is_submitted(plan, fake):
    plan.results.prepare(plan.study)
    plan.results.submissions.write_text("a file")
    with pytest.raises(ResultsError, match=r"submissions: cannot be written .*nothing is"):
        submit(plan, Limits(), print)
    assert fake.calls("sbatch") == []


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[]",
        b"{}",
        b"\xff",
        b'{"job": "x", "kind": "array", "submitted": "", "tasks": []}',
        b'{"job": 102, "kind": "array", "tasks": [0], "share": 3}',  # as of another version
        None,
    ],
)
def test_a_damaged_record_is_named_and_stops_no_status(plan, fake, content):
    submit(plan, Limits(), print)
    fake.answers("squeue", "echo '101|0|RUNNING|None'")
    damaged = plan.results.submissions / "102.json"
    damaged.unlink()
    if content is None:
        damaged.mkdir()
    else:
        damaged.write_bytes(content)
    problem = f"{damaged}: cannot be read .*: delete it once its job has ended"
    status = read_status(plan.results)
    assert [re.fullmatch(problem, each) is not None for each in status["problems"]] == [True]
    assert re.search(f"\n  {problem}\n", describe_status(status))
    assert [each["job"] for each in status["tasks"]] == [101]
    with pytest.raises(SlurmError, match=problem):
        submit(plan, Limits(), print)
    assert len(fake.calls("sbatch")) == 2


def test_a_number_that_cannot_be_kept_is_said(plan, fake, monkeypatch):
    """The disk is full as of now."""

    def full(path, _):
        raise OSError(28, "No space left on device", path)

    monkeypatch.setattr(slurm, "write_whole", full)
    with pytest.raises(SlurmError, match=r"not recorded .*No space.*`scancel 101`.*queued: 101;"):
        submit(plan, Limits(), print)


def test_a_missing_aggregation_is_made_up_for(plan, fake):
    """It was refused; it was cancelled; the study was edited; results came after the report."""
    refused = f"[ $(wc -l < {fake.folder}/sbatch.calls) = 1 ] && echo 101 || exit 1"
    fake.answers("sbatch", refused)
    limits = Limits(minutes=120, max_tasks=1)
    with pytest.raises(SlurmError, match="queued: 101"):
        submit(plan, limits, print)
    fake.answers("sbatch", f"echo $((100 + $(wc -l < {fake.folder}/sbatch.calls)))")
    running = "echo '101|0|RUNNING|None'"
    fake.answers("squeue", running)
    lines = []
    assert submit(plan, limits, lines.append, dry_run=True) == []
    assert "afterany:101\n" in lines[-1]
    assert submit(plan, limits, print) == [103]
    assert "--dependency=afterany:101\n" in (fake.folder / "script-3").read_text()
    fake.answers("squeue", f"{running}; echo '103|N/A|PENDING|Dependency'")
    assert submit(plan, limits, print) == []
    for job in plan.run:
        plan.results.job_file(job.id).write_bytes(b"")
    done = make_plan(plan.study, plan.results, measure=False)
    fake.answers("squeue", "")
    assert submit(done, limits, print) == [104]
    assert "dependency" not in (fake.folder / "script-4").read_text()
    fake.answers("squeue", "echo '104|N/A|RUNNING|None'")
    assert submit(done, limits, print) == []
    fake.answers("squeue", "")
    report = plan.results.report_file
    report.write_text(f"a page {plan.results.fingerprint()}")
    assert submit(done, limits, print) == []
    plan.results.study_file.write_text("before its last edit, which needs no new job")
    assert submit(done, limits, print) == [105]
    assert plan.results.study_file.read_text() == plan.study.text
    assert submit(done, limits, print) == []
    os.utime(plan.results.job_file(plan.run[0].id), (1, 1))  # replaced by an older copy
    assert submit(done, limits, print) == [106]


def test_an_aggregation_that_waits_for_older_arrays_alone_does_not_count(plan, fake):
    plan.results.prepare(plan.study)
    shares = [[job.id] for job in plan.run]
    plan.results.submissions.mkdir()
    write_division(plan.results.submissions, shares)
    for kept in (
        Submission(5, "array", "", file_name(shares), tasks=(0,)),
        Submission(6, "aggregation", ""),
        Submission(7, "array", "", file_name(shares), tasks=tuple(range(1, 12)), offset=1),
    ):
        slurm.record(plan.results, kept)
    queue = 'for i in 0 1 2 3 4 5 6 7 8 9 10; do echo "7|$i|RUNNING|None"; done'
    fake.answers("squeue", f"echo '5|0|RUNNING|None'; echo '6|N/A|PENDING|Dependency'; {queue}")
    assert submit(plan, Limits(), print) == [101]
    assert "afterany:5:7\n" in (fake.folder / "script-1").read_text()


@pytest.mark.parametrize("answer", ["", "echo 'not a number'", "exit 1"])
def test_an_answer_without_a_number_is_an_error(plan, fake, answer):
    """An empty number with exit code 0 would look like a running study."""
    fake.answers("sbatch", answer)
    with pytest.raises(SlurmError, match="nothing is queued"):
        submit(plan, Limits(), print)
    assert slurm.submissions(plan.results) == ([], [])


def test_without_slurm_there_is_nothing_to_submit_to(plan, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert slurm.queue() is None
    assert slurm.max_array_size() == 1001
    with pytest.raises(SlurmError, match="no sbatch on the PATH"):
        submit(plan, Limits(), print)


def test_the_command_line_submits(tmp_path, environment, fake):
    environment["PATH"] = f"{fake.folder}:/usr/bin:/bin"
    study = write_study(tmp_path, replicates=1)
    given = ("submit", study, "--results", tmp_path / "results")
    code, output = run(environment, *given)
    assert (code, "no job is measured yet" in output) == (2, True), output
    code, output = run(environment, *given, "--time", 10, "--max-tasks", 2, "--mem", 1500)
    assert code == 0, output
    assert "array 101: tasks 0-1 of 2" in output
    assert "aggregation 102: after 101, however they end" in output
    assert "#SBATCH --mem=1500M" in (fake.folder / "script-1").read_text()
    fake.answers("squeue", "echo '101|0|RUNNING|None'; echo '101|1|PENDING|Priority'")
    code, output = run(environment, "status", study, "--watch", "--json")
    assert (code, "give one of them" in output) == (2, True), output
    code, output = run(environment, "status", study, "--results", tmp_path / "results")
    assert code == 0
    assert "Slurm: array 101: 1 running, 1 waiting (Priority)" in output
    fake.answers("squeue", "")
    fake.answers("sacct", "echo '101_0|TIMEOUT'; echo '101_1|CANCELLED by 0'; echo '102|COMPLETED'")
    shown = json.loads(run(environment, "status", tmp_path / "results/study", "--json")[1])
    assert [each["tasks"] for each in shown["tasks"]] == [
        {"timeout": 1, "cancelled": 1},
        {"completed": 1},
    ]
    assert shown["missing"] == 3  # accounts only explain; files decide
    assert shown["failed"] == []


def test_jobs_are_held_by_the_tasks_that_live(tmp_path):
    results = Results(tmp_path)
    results.submissions.mkdir()
    shares = [[f"{k}a", f"{k}b"] for k in range(9)]
    write_division(results.submissions, shares)
    submitted = [
        Submission(5, "array", "", file_name(shares), tasks=(0, 1, 2), offset=0),
        Submission(6, "array", "", file_name(shares), tasks=(4, 5), offset=4),
        Submission(7, "aggregation", ""),
    ]
    queue = [
        Task(5, 2, "RUNNING", ""),
        Task(6, 1, "PENDING", ""),
        Task(7, None, "PENDING", ""),
        Task(99, 0, "RUNNING", ""),
    ]
    assert held(results, submitted, queue) == {"2a", "2b", "5a", "5b"}


@pytest.mark.parametrize(
    ("indices", "text"), [([0], "0"), ([0, 1, 2, 3], "0-3"), ([0, 2, 3, 7], "0,2-3,7"), ([], "")]
)
def test_index_list(indices, text):
    assert index_list(indices) == text


def test_the_environment_of_a_user_decides_only_what_submit_does_not(plan, fake, monkeypatch):
    """Variables for sbatch outrank the lines of a script, and those for squeue hide tasks."""
    given = ("SBATCH_PARTITION", "SBATCH_TIMELIMIT", "SBATCH_WAIT", "SBATCH_ACCOUNT", "SBATCH_QOS")
    for name in (*given, "SQUEUE_PARTITION", "SQUEUE_STATES"):
        monkeypatch.setenv(name, "7")
    seen = f"env | grep -o '^S[A-Z]*_[A-Z]*' > {fake.folder}/$1.seen"
    fake.answers("sbatch", f"{seen}; echo 101")
    fake.answers("squeue", seen)
    submit(plan, Limits(partition="main"), print)
    left = (fake.folder / "--parsable.seen").read_text().split()
    assert {name for name in left if name.startswith("SBATCH")} == {"SBATCH_ACCOUNT", "SBATCH_QOS"}
    assert "SQUEUE" not in (fake.folder / "--me.seen").read_text()
    submit(plan, Limits(account="mine"), print)
    left = (fake.folder / "--parsable.seen").read_text().split()
    assert "SBATCH_PARTITION" in left
    assert "SBATCH_ACCOUNT" not in left


def test_a_silent_queue_is_said(plan, fake, monkeypatch):
    slurm.max_array_size()
    submit(plan, Limits(), print)
    monkeypatch.setattr(slurm, "ANSWER_SECONDS", 0.3)
    for answer in ("exec sleep 20", "exit 1", "echo 'slurm_load_jobs: Try again'"):
        fake.answers("squeue", answer)
        began = time.monotonic()
        said = describe_status(read_status(plan.results))
        assert "Slurm: squeue does not answer: what waits and runs is not known" in said
        assert time.monotonic() < began + 15
        with pytest.raises(SlurmError, match="squeue does not answer"):
            submit(plan, Limits(), print)


def test_odd_lines_of_an_answer_are_skipped(plan, fake):
    submit(plan, Limits(minutes=60, max_tasks=2), print)
    lines = ("CLUSTER: main", "101|0|RUNNING|None", "squeue: warning | of | some | kind", "")
    fake.answers("squeue", "; ".join(f"echo '{line}'" for line in lines))
    assert slurm.queue() == [Task(101, 0, "RUNNING", "None")]
    assert "-r" in fake.calls("squeue")[0].split()  # or tasks that wait share a line
    lines = ("sacct: odd", "odd|FAILED", "101_[1-2]|PENDING", "101_0|RUNNING", "101_1|TIMEOUT", "")
    fake.answers("sacct", "; ".join(f"echo '{line}'" for line in lines))
    assert slurm.ended([101]) == {101: Counter(TIMEOUT=1)}
    [array, _] = read_status(plan.results)["tasks"]
    assert array["tasks"] == {"running": 1, "timeout": 1}


def test_an_empty_queue_of_a_named_cluster_is_empty(plan, fake):
    """With SLURM_CLUSTERS squeue says its name in any case."""
    submit(plan, Limits(), print)
    fake.answers("squeue", "echo 'CLUSTER: main'")
    assert slurm.queue() == []
    assert [each["tasks"] for each in read_status(plan.results)["tasks"]] == [
        {"ended": 2},
        {"ended": 1},
    ]
    assert submit(plan, Limits(), print) == [103, 104]


def test_an_answer_may_be_in_any_encoding(fake):
    fake.answers("squeue", r"printf '101|0|RUNNING|Gr\374n\n'")
    [task] = slurm.queue()
    assert (task.job, task.index, task.state) == (101, 0, "RUNNING")


def test_what_failed_before_runs_last(plan):
    first, *others = [job.id for job in plan.run]
    plan.results.prepare(plan.study)
    plan.results.record_failure(Failure(first, "crash", "its worker died"))
    again = make_plan(plan.study, plan.results)
    assert [job.id for job in again.run] == [*others, first]


def test_what_failed_by_physics_is_tried_once_more_when_told(plan, fake):
    """And not at every requeue of a task, which runs the same script."""
    failed, held_back, crashed = plan.run[:3]
    limits = Limits(minutes=60, max_tasks=1)
    plan.results.prepare(plan.study)
    plan.results.record_failure(Failure(failed.id, "physics", "the spring broke"))
    plan.results.record_failure(Failure(crashed.id, "crash", "its worker died"))
    submit(make_plan(plan.study, plan.results), limits, print)
    assert failed.id not in flat(jobs_of(fake, 1))
    told = make_plan(plan.study, plan.results, retry_failed=True)
    submit(told, limits, print, dry_run=True)
    assert plan.results.failures().keys() == {failed.id, crashed.id}
    submit(told, limits, print)
    assert plan.results.failures().keys() == {crashed.id}
    assert failed.id in flat(jobs_of(fake, 3))
    plan.results.record_failure(Failure(held_back.id, "physics", "the spring broke"))
    [task] = jobs_of(fake, 3)
    assert held_back.id not in task  # it has been tried in this run of the task
    assert failed.id in task  # its turn had not come


def test_a_log_goes_to_a_folder_of_any_name(plan, fake, tmp_path):
    """``%A`` in it would be the number of the array; a backslash makes ``%A`` mean itself."""
    submit(replace(plan, results=Results(tmp_path / "50%A b/study")), Limits(), print)
    script = (fake.folder / "script-1").read_text()
    assert f"#SBATCH --output='{tmp_path}/50%%A b/study/logs/slurm-%A_%a.log'\n" in script
    odd = "\udcfcber\ta\u00a0b"  # an ü of another encoding, a tab and a space that does not break
    submit(replace(plan, results=Results(tmp_path / odd / "study")), Limits(), print)
    script = (fake.folder / "script-3").read_bytes()
    assert (
        f"#SBATCH --output='{tmp_path}/{odd}/study/logs/".encode(errors="surrogateescape") in script
    )
    for name in ("back\\slash", "two\nlines"):
        with pytest.raises(PlanError, match="Slurm writes no logs to a folder with a backslash"):
            submit(replace(plan, results=Results(tmp_path / name / "study")), Limits(), print)
    assert len(fake.calls("sbatch")) == 4


def test_a_task_within_its_limit_is_not_called_longer(plan):
    plan.wall_s._sum = {key: value / 300 for key, value in plan.wall_s._sum.items()}
    layout = lay_out(plan, Limits(minutes=5), set())
    assert layout.seconds == pytest.approx(12)
    assert "longer" not in describe(layout, 1)
    assert "longer than the limit" in describe(replace(layout, seconds=190.0), 1)


@pytest.mark.usefixtures("fake")
class TestRequeue:
    def runs(self, monkeypatch, folder, restarts, progress):
        monkeypatch.setenv("SLURM_RESTART_COUNT", str(restarts))
        return slurm.requeue("12_3", folder, progress=progress)

    def test_runs_without_progress_are_capped_and_those_with_it_are_not(
        self, fake, tmp_path, monkeypatch
    ):
        given = [True, False, False, True, False, False, False, False]
        answers = [self.runs(monkeypatch, tmp_path, n, p) for n, p in enumerate(given)]
        assert answers[:6] == [None] * 6
        assert all("no job has got any further in 3 runs" in answer for answer in answers[6:])
        assert fake.calls("scontrol") == ["requeue 12_3"] * 6

    def test_a_task_that_never_gets_anywhere_stops_after_three_runs(self, tmp_path, monkeypatch):
        answers = [self.runs(monkeypatch, tmp_path, n, progress=False) for n in range(4)]
        assert [answer is None for answer in answers] == [True, True, False, False]

    def test_runs_that_slurm_ended_are_not_judged(self, tmp_path, monkeypatch):
        """Of a node that died twice, and then a warning."""
        assert self.runs(monkeypatch, tmp_path, 2, progress=False) is None

    def test_a_refusal_is_said(self, fake, tmp_path, monkeypatch):
        fake.answers("scontrol", "exit 1")
        assert "did not work" in self.runs(monkeypatch, tmp_path, 0, progress=True)

    def test_a_task_knows_its_name(self, monkeypatch):
        for name in ("SLURM_JOB_ID", "SLURM_ARRAY_JOB_ID", "SLURM_ARRAY_TASK_ID"):
            monkeypatch.delenv(name, raising=False)
        assert slurm.this_task() is None
        monkeypatch.setenv("SLURM_JOB_ID", "14")
        assert slurm.this_task() == "14"
        monkeypatch.setenv("SLURM_ARRAY_JOB_ID", "12")
        monkeypatch.setenv("SLURM_ARRAY_TASK_ID", "3")
        assert slurm.this_task() == "12_3"
