"""Studies end with the same result on threads, processes and a cluster, whoever dies on the way."""

import asyncio
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fracid.errors import InputError, Unfinished
from fracid.tasks import cluster as cluster_tasks
from fracid.tasks.job import Progress, Task
from fracid.tasks.journal import Journal
from fracid.tasks.local import follow_parent
from fracid.tasks.tasks import run_tasks

HERE = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
"""The environment of a process that is to find this module."""

STUDY = [Task(f"seed {seed}", (seed,)) for seed in range(12)]


# What the studies do: functions of this module, so that other processes find them.


def drawn(seed):
    """Numbers that need all their digits, from the task's own seed alone."""
    rng = np.random.default_rng(seed)
    return {"cost": float(rng.standard_normal()), "values": tuple(rng.standard_normal(3).tolist()), "none": None}


def counted(folder, seed):
    """Leave a mark for each time it is done."""
    (Path(folder) / f"{seed}-{os.getpid()}-{time.monotonic_ns()}").touch()
    return drawn(seed)


def fails_at(bad, seed):
    if seed == bad:
        raise ZeroDivisionError("no such swing")
    return seed


def raises(sentence):
    raise ValueError(sentence)


def returns(what):
    return {"nan": float("nan"), "numpy": np.int64(3), "set": {1}}[what]


def refuses(seed):
    raise InputError(f"seed {seed} is not possible")


def kills_once(folder, seed):
    """The worker that comes first to seed 3 is killed in the middle of it."""
    mark = Path(folder) / "killed"
    if seed == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.02)
    return drawn(seed)


def slowly_drawn(seed):
    time.sleep(0.1)
    return drawn(seed)


def kills_always(seed):
    if seed == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return seed


def interrupts(seed):
    if seed == 3:
        os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.01)
    return seed


def most_blas_threads():
    from threadpoolctl import threadpool_info

    return max(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")


class Sent:
    """Counts how often it is taken out of a parcel, in a file."""

    def __init__(self, folder):
        self.folder = str(folder)

    def __reduce__(self):
        return received, (self.folder,)


def received(folder):
    (Path(folder) / f"{os.getpid()}-{time.monotonic_ns()}").touch()
    return Sent(folder)


def shared(sent, seed, numbers):
    return drawn(seed) | {"sum": float(numbers.sum()), "blas": most_blas_threads(), "where": sent.folder}


def waits(folder):
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(120)


# --- the same result -------------------------------------------------------------------------------


@pytest.mark.few(2)
@pytest.mark.parametrize(("executor", "jobs"), [("threads", 1), ("threads", 3), ("processes", 2)])
def test_every_executor_gives_the_same_to_the_bit_in_order_with_linear_algebra_on_one_thread(executor, jobs, tmp_path):
    sent, numbers = Sent(tmp_path), np.arange(4.0)
    found = run_tasks(shared, [Task(t.key, (sent, *t.arguments, numbers)) for t in STUDY], executor=executor, jobs=jobs)
    assert list(found) == [t.key for t in STUDY]
    assert found == {t.key: {**drawn(*t.arguments), "values": list(drawn(*t.arguments)["values"]),
                             "sum": 6.0, "blas": 1, "where": str(tmp_path)} for t in STUDY}  # fmt: skip
    arrived = [path.name.split("-")[0] for path in tmp_path.iterdir()]
    assert len(arrived) == len(set(arrived)) <= jobs  # what all tasks share goes to each process once


def test_threads_give_linear_algebra_back_its_own():
    before = most_blas_threads()
    run_tasks(most_blas_threads, [Task("a", ())])
    assert most_blas_threads() == before


def test_what_cannot_be_sent_is_said_before_anything_is_done():
    def local():
        pass

    with pytest.raises(InputError, match=r"cannot be sent to other processes: .*local.* Type --executor threads"):
        run_tasks(drawn, [Task("a", (local,)), Task("b", (local,))], executor="processes")


def test_what_the_journal_has_is_not_done_again(tmp_path):
    marks = tmp_path / "marks"
    marks.mkdir()
    tasks = [Task(f"seed {seed}", (str(marks), seed)) for seed in range(6)]
    with Journal(tmp_path / "journal.jsonl", {}) as journal:
        first = run_tasks(counted, tasks[:4], journal=journal)
    with Journal(tmp_path / "journal.jsonl", {}) as journal:
        whole = run_tasks(counted, tasks, journal=journal, jobs=2)
    assert sorted(int(mark.name.split("-")[0]) for mark in marks.iterdir()) == [0, 1, 2, 3, 4, 5]
    assert {key: whole[key] for key in first} == first
    assert whole == run_tasks(drawn, STUDY[:6])


def test_journals_of_slices_of_a_study_are_joined_by_joining_their_lines(tmp_path):
    whole = run_tasks(drawn, STUDY)
    for shard in range(3):
        with Journal(tmp_path / f"{shard}.jsonl", {"seeds": 12}) as journal:
            run_tasks(drawn, STUDY[shard::3], journal=journal)
    header, *lines = (tmp_path / "0.jsonl").read_text().splitlines(keepends=True)
    for shard in (1, 2):
        lines += (tmp_path / f"{shard}.jsonl").read_text().splitlines(keepends=True)[1:]
    (tmp_path / "all.jsonl").write_text(header + "".join(lines))
    with Journal(tmp_path / "all.jsonl", {"seeds": 12}) as journal:
        assert run_tasks(refuses, STUDY, journal=journal) == whole
        assert list(run_tasks(refuses, STUDY, journal=journal)) == list(whole)


def test_progress_counts_those_done_before_apart(tmp_path):
    seen = []
    with Journal(tmp_path / "journal.jsonl", {}) as journal:
        run_tasks(drawn, STUDY[:4], journal=journal)
        run_tasks(drawn, STUDY, journal=journal, progress=seen.append)
    assert [(p.done, p.total, p.earlier) for p in seen] == [(n, 12, 4) for n in range(4, 13)]
    assert {p.best for p in seen} == {None}, "costs of different data cannot be compared"


def test_the_time_left_is_that_of_the_rest_at_the_rate_of_this_process():
    half = Progress(done=30, total=100, earlier=10, seconds=5.0)
    assert half.rate == 4.0
    assert half.left == 17.5
    assert Progress(10, 100, 10, 0.0).left is None


# --- mistakes --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("work", "tasks", "options", "message"),
    [
        (drawn, [Task("a", (1,)), Task("a", (2,))], {}, r"Two tasks have the key 'a'"),
        (drawn, STUDY, {"executor": "thread"}, r"no executor 'thread'; type one of threads, processes, or .*tcp://"),
        (drawn, STUDY, {"jobs": 0}, r"jobs = 0; expected a whole number, 1 or more"),
        (lambda: 1, STUDY, {"executor": "processes"}, r"cannot be sent to other processes: .*function of a module"),
        (drawn, STUDY, {"executor": "tcp://127.0.0.1:9"}, r"No Dask scheduler answers at tcp://127.0.0.1:9.*--exec"),
        (drawn, STUDY, {"executor": "ftp://x"}, r"No Dask scheduler answers at ftp://x"),
    ],
)
def test_a_mistake_is_a_sentence(work, tasks, options, message, monkeypatch):
    monkeypatch.setattr("fracid.tasks.cluster.ANSWER", 0.3)
    with pytest.raises(InputError, match=message):
        run_tasks(work, tasks, **options)


@pytest.mark.broad
def test_a_repetition_that_raises_is_named_and_what_was_done_is_kept(tmp_path):
    tasks = [Task(f"seed {seed}", (7, seed)) for seed in range(12)]
    with Journal(tmp_path / "journal.jsonl", {}) as journal:
        with pytest.raises(Unfinished, match=r"'seed 7' failed: ZeroDivisionError: no such swing\..*fracid resume"):
            run_tasks(fails_at, tasks, executor="processes", journal=journal)
        assert {f"seed {seed}" for seed in range(7)} <= set(journal.done)


@pytest.mark.parametrize(
    ("what", "message"),
    [("nan", "'a' failed: ValueError: Out of range float"), ("numpy", "int64 is not JSON"), ("set", "set is not JSON")],
)
def test_a_result_that_is_no_json_value_is_refused(what, message):
    with pytest.raises(Unfinished, match=message):
        run_tasks(returns, [Task("a", (what,))])


def test_a_sentence_that_ended_a_repetition_keeps_its_one_full_stop():
    with pytest.raises(Unfinished, match=r"failed: ValueError: It does not rest\. 0 of 1"):
        run_tasks(raises, [Task("a", ("It does not rest.",))])


def test_ctrl_c_starts_nothing_new_and_keeps_what_was_done(tmp_path):
    tasks = [Task(f"seed {seed}", (seed,)) for seed in range(100)]
    with Journal(tmp_path / "journal.jsonl", {}) as journal:
        with pytest.raises(Unfinished, match=r"Interrupted\. \d of 100 repetitions are done and kept"):
            run_tasks(interrupts, tasks, journal=journal)
        assert 4 <= len(journal.done) <= 8


# --- who dies --------------------------------------------------------------------------------------


@pytest.mark.broad
def test_a_killed_worker_process_costs_nothing_but_time(tmp_path):
    tasks = [Task(f"seed {seed}", (str(tmp_path), seed)) for seed in range(12)]
    with Journal(tmp_path / "journal.jsonl", {}) as journal:
        found = run_tasks(kills_once, tasks, executor="processes", jobs=2, journal=journal)
    assert (tmp_path / "killed").exists()
    assert found == run_tasks(drawn, STUDY)
    keys = [json.loads(line)["key"] for line in (tmp_path / "journal.jsonl").read_text().splitlines()[1:]]
    assert sorted(keys) == sorted(found)


@pytest.mark.broad
def test_a_repetition_that_kills_every_worker_is_named(tmp_path):
    with Journal(tmp_path / "journal.jsonl", {}) as journal:
        with pytest.raises(Unfinished, match=r"'seed 3' was given up: a worker process died twice"):
            run_tasks(kills_always, STUDY, executor="processes", jobs=2, journal=journal)
        assert "seed 3" not in journal.done
        assert {"seed 0", "seed 1", "seed 2"} <= set(journal.done)


@pytest.mark.broad
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL")
def test_workers_go_with_a_parent_that_was_killed(tmp_path):
    code = (
        f"from test_tasks import waits\nfrom fracid.tasks.tasks import Task, run_tasks\n"
        f"if __name__ == '__main__': run_tasks(waits, [Task(str(i), ({str(tmp_path)!r},)) for i in range(2)],"
        " executor='processes', jobs=2)"
    )
    script = tmp_path / "study.py"
    script.write_text(code)
    parent = subprocess.Popen([sys.executable, str(script)], env=HERE)
    workers = until(lambda: [int(p.name) for p in tmp_path.iterdir() if p.name.isdigit()], 2)
    parent.kill()
    parent.wait()
    assert until(lambda: [pid for pid in workers if not alive(pid)], 2)


def until(what, count, patience=60.0):
    """Wait until `what` gives so many."""
    end = time.monotonic() + patience
    while len(found := what()) < count:
        assert time.monotonic() < end, f"{len(found)} of {count}"
        time.sleep(0.05)
    return found


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] != "Z"
    except OSError:
        return False


# --- a cluster -------------------------------------------------------------------------------------


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """A scheduler, a process of its own on loopback: its address, itself, and what starts two workers."""
    pytest.importorskip("distributed")

    def started(*command):
        log = (tmp_path / f"{command[0]}-{len(processes)}.log").open("w")
        module = f"distributed.cli.dask_{command[0]}"
        processes.append(subprocess.Popen([sys.executable, "-m", module, *command[1:]], env=HERE,
                                          cwd=tmp_path, stdout=log, stderr=log))  # fmt: skip
        log.close()

    processes: list[subprocess.Popen] = []
    monkeypatch.setitem(HERE, "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL", "4s")  # five minutes, if nobody says so
    where = tmp_path / "scheduler.json"
    started("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(where))
    until(lambda: [where] if where.exists() and where.stat().st_size else [], 1)

    def start_workers():
        for _ in range(2):
            started("worker", "--scheduler-file", str(where), "--nthreads", "1", "--no-nanny", "--no-dashboard")

    yield json.loads(where.read_text())["address"], processes, start_workers
    for process in reversed(processes):
        process.kill()
        process.wait()


def test_a_result_that_is_lost_with_its_worker_is_waited_for_and_the_others_go_on(monkeypatch):
    monkeypatch.setattr(cluster_tasks, "IDLE", 0.001)
    first, lost = (SimpleNamespace(status=s) for s in ("finished", "lost"))
    scheduler = SimpleNamespace(status="running", nthreads=lambda: setattr(lost, "status", "finished") or {"worker": 1})
    ends = cluster_tasks._Ends(scheduler, "tcp://127.0.0.1:1")
    for future in (lost, first):
        ends.put(future)
    assert ends.wait() == [first]
    assert lost.status == "lost"
    assert ends.wait() == [lost]  # computed anew while nothing else ends


def test_a_result_that_never_comes_ends_the_study_where_the_scheduler_is_gone(monkeypatch):
    """Its worker was lost before it gave it, and with the scheduler nobody computes it anew."""
    monkeypatch.setattr(cluster_tasks, "IDLE", 0.01)
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    never = SimpleNamespace(status="running", nthreads=dict, loop=SimpleNamespace(asyncio_loop=loop),
                            gather=lambda _, asynchronous: asyncio.sleep(3600))  # fmt: skip
    ends = cluster_tasks._Ends(never, "tcp://127.0.0.1:1")
    never.status = "closed"
    try:
        with pytest.raises(cluster_tasks.Stopped, match=r"The Dask scheduler at tcp://127\.0\.0\.1:1 is gone"):
            ends.results([])
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.run_until_complete(asyncio.sleep(0))  # what was cancelled ends
        loop.close()


@pytest.mark.broad
def test_a_study_on_a_cluster_ends_with_each_repetition_done_once_though_a_worker_is_killed(
    cluster, tmp_path, monkeypatch
):
    monkeypatch.setattr("fracid.tasks.cluster.ANSWER", 2.0)  # how long a scheduler is waited for that is gone
    address, (scheduler,), start_workers = cluster
    with monkeypatch.context() as impatient:
        impatient.setattr("fracid.tasks.cluster.PATIENCE", 0.3)
        impatient.setattr("fracid.tasks.cluster.IDLE", 0.2)
        with pytest.raises(Unfinished, match=rf"has had no worker for 0 s: start some with dask worker {address}\."):
            run_tasks(drawn, STUDY, executor=address)
    start_workers()
    marks = tmp_path / "marks"
    marks.mkdir()
    tasks = [Task(f"seed {seed}", (str(marks), seed)) for seed in range(60)]
    with Journal(tmp_path / "journal.jsonl", {}) as journal:
        found = run_tasks(kills_once, tasks, executor=address, journal=journal)
    assert (marks / "killed").exists()
    assert found == run_tasks(drawn, [Task(t.key, (seed,)) for seed, t in enumerate(tasks)])
    keys = [json.loads(line)["key"] for line in (tmp_path / "journal.jsonl").read_text().splitlines()[1:]]
    assert sorted(keys) == sorted(found)

    def kill(progress):
        if progress.done == 10:
            scheduler.kill()

    with Journal(tmp_path / "second.jsonl", {}) as journal:
        with pytest.raises(Unfinished, match=rf"The Dask scheduler at {address} is gone\. \d+ of 60 .* are done and k"):
            run_tasks(kills_once, tasks, executor=address, journal=journal, progress=kill)
        assert len(journal.done) >= 10
        assert run_tasks(drawn, [Task(t.key, (i,)) for i, t in enumerate(tasks)], journal=journal) == found


@pytest.mark.broad
@pytest.mark.skipif(sys.platform == "win32", reason="SIGSTOP")
def test_a_worker_that_hangs_is_left_and_a_study_whose_workers_all_hang_ends_and_says_so(cluster, monkeypatch):
    address, processes, start_workers = cluster
    start_workers()
    tasks = [Task(f"seed {seed}", (seed,)) for seed in range(40)]

    def hang(*which):
        return lambda progress: [processes[i].send_signal(signal.SIGSTOP) for i in which if progress.done == 5]

    assert run_tasks(slowly_drawn, tasks, executor=address, progress=hang(1)) == run_tasks(drawn, tasks)
    monkeypatch.setattr("fracid.tasks.cluster.PATIENCE", 1.0)
    monkeypatch.setattr("fracid.tasks.cluster.IDLE", 0.2)
    with pytest.raises(Unfinished, match=r"has had no worker for 1 s: start some"):
        run_tasks(slowly_drawn, tasks, executor=address, progress=hang(2))


def no_process(*_, **__):
    raise BlockingIOError(11, "Resource temporarily unavailable")


@pytest.mark.parametrize(
    "place",
    ["resource_tracker.ensure_running", "util.spawnv_passfds", "context.BaseContext.Lock"],
)
def test_where_no_process_can_be_started_threads_do_the_study_and_it_is_said(place, monkeypatch, caplog):
    with monkeypatch.context() as patch:
        patch.setattr(f"multiprocessing.{place}", no_process)
        results = run_tasks(drawn, STUDY, executor="processes", jobs=2)
    assert results == run_tasks(drawn, STUDY)
    (said,) = caplog.messages
    assert said.startswith("No process can be started here ([Errno 11] Resource temporarily unavailable): threads")


def test_a_worker_whose_parent_died_while_it_started_ends_at_once(monkeypatch):
    class Gone:
        def is_alive(self):
            return False

    def ended(code):
        raise SystemExit(code)

    monkeypatch.setattr("multiprocessing.parent_process", Gone)
    monkeypatch.setattr("os._exit", ended)
    before = signal.getsignal(signal.SIGINT)
    try:
        with pytest.raises(SystemExit, match="1"):
            follow_parent()
    finally:
        signal.signal(signal.SIGINT, before)
