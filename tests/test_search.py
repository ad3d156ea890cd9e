"""Architecture search: the paper's space and formula, stacked training against the plain loop, interruptions."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crfbench.curves import GRID
from crfbench.datasets import load_opencrf
from crfbench.errors import FormatError, InputError, WorkerError
from crfbench.metrics import mse
from crfbench.paper.results import load_recorded
from crfbench.search.result import COLUMNS, Journal, SearchResult, architecture, mark_choice, pareto_front, tabulate
from crfbench.search.space import Outcome, SearchSpace, complexity
from crfbench.search.strategies import STRATEGIES, find_strategy, halving, optuna, random

torch = pytest.importorskip("torch", reason="PyTorch is absent: pip install 'crfbench[train]'")

from crfbench.search import search_architectures  # noqa: E402
from crfbench.search.run import BLOCKS, N_FOLDS, make_folds, pack, search_config, work  # noqa: E402
from crfbench.search.stacked import Stack, StackedNetworks, initial_trainer, train_stack  # noqa: E402
from crfbench.training import Autoencoder, TrainingConfig  # noqa: E402

SMALL = SearchSpace(h1=(5, 10), h2=(0, 5), h3=(0, 4))  # 6 candidates
CONFIG = TrainingConfig(epochs=20, learning_rate=1e-3, smoothness=0.0)  # the loss falls at every step
widths = st.lists(st.integers(1, 600), min_size=1, max_size=3).map(tuple)


@pytest.fixture(scope="module")
def responses():
    return load_opencrf().select(range(0, 150, 5))


@pytest.fixture(scope="module")
def curves(responses):
    return responses.in_direction("inverse")


@pytest.fixture
def pool():
    with ThreadPoolExecutor(1) as executor:
        yield executor


# ---- the space and complexity


def test_the_papers_space_has_156_candidates():
    space = SearchSpace()
    assert len(space) == len(set(space)) == 156
    assert all(1 <= len(hidden) <= 3 and min(hidden) > 0 for hidden in space)
    assert {(500, 200, 100), (10,), (50, 20)} <= set(space)


def test_a_third_layer_needs_a_second():
    assert list(SearchSpace(h1=(3,), h2=(0, 2), h3=(0, 1))) == [(3,), (3, 2), (3, 2, 1)]


@pytest.mark.parametrize(
    "wrong", [{"h1": ()}, {"h1": (0, 5)}, {"h2": (-1,)}, {"h3": (5, 5)}, {"h2": (0,), "h3": (5,)}], ids=str
)
def test_impossible_spaces_are_refused(wrong):
    with pytest.raises(InputError, match=r"use one or more different widths|allow h3=0|use a whole number"):
        SearchSpace(**wrong)


@pytest.mark.parametrize(
    ("hidden", "count"),
    [
        ((10,), 1024 * 10 + 10 + 10 + 1),
        ((50, 20), 1024 * 50 + 50 + 50 * 20 + 20 + 20 + 1),
        ((500, 200, 100), 1024 * 500 + 500 + 500 * 200 + 200 + 200 * 100 + 100 + 100 + 1),
    ],
)
def test_complexity_by_hand(hidden, count):
    assert complexity(hidden) == count


@settings(max_examples=20)
@given(widths, st.integers(1, 3))
def test_complexity_against_pytorch(hidden, k):
    from crfbench.models.slr import SLR

    network = Autoencoder(SLR(hidden, k))
    halves = [sum(w.numel() for w in half.parameters()) for half in (network.encoder, network.decoder)]
    assert halves[0] == complexity(hidden, k)
    # The decoder has the same weights, and at its end a bias for each sample instead of each latent.
    assert halves[1] == complexity(hidden, k) + 1024 - k


# ---- stacked training


def plain(curves, folds, hidden, config):
    errors = []
    for fold in range(N_FOLDS):
        trainer = initial_trainer(curves[folds != fold], "inverse", replace(config, hidden=hidden))
        for _ in range(config.epochs):
            trainer.epoch()
        held_out = curves[folds == fold]
        errors.append(mse(trainer.model().decode(trainer.model().encode(held_out)), held_out).mean())
    return errors


@pytest.mark.parametrize("hidden", [(7,), (10, 4), (8, 5, 6)])
def test_without_thinning_stacked_is_the_plain_loop(curves, responses, hidden):
    folds = make_folds(responses, "random", 0)
    wider = tuple(width + 3 for width in hidden)  # so that the candidate is padded
    outcome = train_stack(Stack(curves, "inverse", folds, (hidden, wider), CONFIG, 1024))[0]
    assert outcome.hidden == hidden
    np.testing.assert_allclose(outcome.mse, plain(curves, folds, hidden, CONFIG), rtol=2e-4)


def test_thinning_changes_little(curves, responses):
    folds = make_folds(responses, "random", 0)
    stack = Stack(curves, "inverse", folds, ((10, 4),), replace(CONFIG, epochs=60, learning_rate=5e-4), 1024)
    full, thin = train_stack(stack)[0], train_stack(replace(stack, blocks=128))[0]
    np.testing.assert_allclose(thin.mse, full.mse, rtol=0.03)
    np.testing.assert_allclose(thin.rmse, full.rmse, rtol=0.03)


def test_a_candidate_is_the_same_in_any_company(curves, responses):
    folds = make_folds(responses, "random", 0)
    alone = train_stack(Stack(curves, "inverse", folds, ((6, 5),), CONFIG, 64))[0]
    among = train_stack(Stack(curves, "inverse", folds, ((6, 3), (6, 5), (6, 9)), CONFIG, 64))[1]
    np.testing.assert_allclose(among.mse, alone.mse, rtol=2e-4)


def test_padding_stays_zero(curves, responses):
    stack = Stack(curves, "inverse", make_folds(responses, "random", 0), ((3, 2), (6, 5)), CONFIG, 64)
    networks = StackedNetworks(stack)
    for _ in range(5):
        networks.epoch()
    assert not networks.weights[1][:N_FOLDS, 3:].any()
    assert not networks.weights[1][:N_FOLDS, :, 2:].any()
    assert networks.weights[1][N_FOLDS:, 3:, 2:].any()


def test_unequal_folds_are_weighed_by_their_own_curves(curves, responses):
    folds = np.repeat([0, 1, 2], [5, 10, 15])
    config = replace(CONFIG, learning_rate=2e-4)
    outcome = train_stack(Stack(curves, "inverse", folds, ((6,),), config, 1024))[0]
    np.testing.assert_allclose(outcome.mse, plain(curves, folds, (6,), config), rtol=2e-4)


# ---- folds and packing


def test_random_folds_are_even_and_follow_the_seed(responses):
    folds = make_folds(responses, "random", 3)
    assert np.bincount(folds).tolist() == [10, 10, 10]
    assert (folds == make_folds(responses, "random", 3)).all()
    assert (folds != make_folds(responses, "random", 4)).any()


def test_grouped_folds_part_no_unit(responses):
    folds = make_folds(responses, "grouped", 0)
    units = np.array(responses.units)
    assert all(len(set(folds[units == unit])) == 1 for unit in set(units))
    assert set(folds) == {0, 1, 2}


def test_every_trial_is_packed_once_with_its_like_and_the_long_ones_first(curves, responses):
    base = Stack(curves, "inverse", make_folds(responses, "random", 0), (), CONFIG, BLOCKS)
    stacks = pack([(hidden, 100) for hidden in SearchSpace()], base)
    assert sorted(hidden for stack in stacks for hidden in stack.hidden) == sorted(SearchSpace())
    for stack in stacks:
        assert len({(len(hidden), hidden[:-1] or hidden) for hidden in stack.hidden}) == 1
    assert [work(stack) for stack in stacks] == sorted(map(work, stacks), reverse=True)


# ---- the choice


def outcomes(figures):
    return [Outcome(hidden, 10, (value, value), (value**0.5,) * 2, 0.1) for hidden, value in figures.items()]


def test_the_choice_is_algorithm_1():
    table = tabulate(outcomes({(50,): 1.0, (10,): 1.3, (20,): 1.1, (100,): 0.9, (10, 10): 2.0}))
    assert tuple(table.columns) == COLUMNS
    assert table["rank"].tolist() == [1, 2, 3, 4, 5]
    assert [architecture(row) for _, row in table.iterrows()] == [(100,), (50,), (20,), (10,), (10, 10)]
    choices = [SearchResult(mark_choice(table, m)).chosen for m in (1, 2, 3, 4, 5, 99)]
    assert choices == [(100,), (50,), (20,), (10,), (10,), (10,)]
    assert (mark_choice(table, 3)["chosen"].sum()) == 1


def test_candidates_trained_for_longer_rank_first_and_alone_make_the_front():
    short, long = Outcome((10,), 5, (0.1,), (0.3,), 1.0), Outcome((20,), 50, (0.2,), (0.4,), 1.0)
    table = tabulate([long, short, replace(short, hidden=(20,))])
    assert table[["h1", "epochs", "rank"]].to_numpy().tolist() == [[20, 50, 1], [10, 5, 2]]
    assert pareto_front(table)["h1"].tolist() == [20]


@given(st.dictionaries(widths, st.floats(1e-4, 1.0), min_size=1, max_size=12), st.integers(1, 15))
def test_choice_and_front_for_any_figures(figures, m):
    table = mark_choice(tabulate(outcomes(figures)), m)
    best = table.nsmallest(m, "rank")
    chosen = table[table["chosen"]].iloc[0]
    assert chosen["rank"] <= m
    assert chosen["complexity"] == best["complexity"].min()
    front = pareto_front(table)
    for _, row in table.iterrows():
        beaten = ((front["mse"] <= row["mse"]) & (front["complexity"] <= row["complexity"])).any()
        assert beaten
    assert front["mse"].is_monotonic_decreasing
    assert front["complexity"].is_monotonic_increasing


# ---- strategies


@pytest.mark.parametrize("name", STRATEGIES)
def test_every_strategy_keeps_the_contract(name):
    if name == "optuna":
        pytest.importorskip("optuna", reason="Optuna is absent: pip install 'crfbench[optuna]'")
    strategy, space = find_strategy(name), SearchSpace(h1=(10, 20, 50), h2=(0, 10), h3=(0, 5))
    done, rounds = {}, 0
    while new := [t for t in strategy(space, 90, dict(done)) if t not in done]:
        assert new == [t for t in strategy(space, 90, dict(done)) if t not in done]
        assert {hidden for hidden, _ in new} <= set(space)
        assert len(set(new)) == len(new)
        # A round that was interrupted half way goes on with the rest of it.
        half = {trial: float(complexity(trial[0])) for trial in new[: len(new) // 2]}
        if name != "optuna":
            assert [t for t in strategy(space, 90, done | half) if t not in done | half] == new[len(half) :]
        done |= {trial: float(complexity(trial[0])) for trial in new}
        rounds += 1
        assert rounds < 20
    assert any(epochs == 90 for _, epochs in done)


def test_halving_keeps_the_best_third():
    space, done = SearchSpace(h1=tuple(range(10, 100, 10)), h2=(0,), h3=(0,)), {}
    sizes = []
    while new := [t for t in halving(space, 90, done) if t not in done]:
        sizes.append((len(new), new[0][1]))
        done |= {trial: -float(trial[0][0]) for trial in new}
    assert sizes == [(9, 10), (3, 30), (1, 90)]
    assert ((90,), 90) in done


@pytest.mark.parametrize("wrong", ["best", 3, None])
def test_unknown_strategies_name_those_there_are(wrong):
    with pytest.raises(InputError, match="use one of grid, random, halving, optuna or a function"):
        find_strategy(wrong)


@pytest.mark.parametrize(
    ("strategy", "wrong"),
    [
        (random, {"n": 0}),
        (halving, {"rounds": 0}),
        (halving, {"factor": 1}),
        (optuna, {"batch": 0}),
        (optuna, {"n": 0}),
    ],
)
def test_impossible_options_of_strategies_are_refused(strategy, wrong):
    with pytest.raises(InputError, match="; use"):
        strategy(SearchSpace(), 90, {}, **wrong)


def test_a_strategy_of_ones_own_is_any_function(responses, pool):
    def widest(space, epochs, done):
        return [(max(space), epochs)]

    for strategy in (widest, partial(random, n=1)):
        assert len(search_architectures(responses, SMALL, 1, strategy, epochs=1, executor=pool).table) == 1


# ---- the search


def test_search_by_grid(responses, pool, tmp_path):
    result = search_architectures(responses, SMALL, m=3, epochs=5, executor=pool, journal=tmp_path / "j.jsonl")
    table = result.table
    assert len(table) == len(SMALL) == 6
    assert table["mse"].is_monotonic_increasing
    assert table["chosen"].sum() == 1
    assert result.chosen == architecture(table[:3].nsmallest(1, "complexity").iloc[0])
    assert (table["rmse"] ** 2 <= table["mse"] * (1 + 1e-6)).all()  # Jensen
    assert SearchResult(mark_choice(table, 6)).chosen == (5,)


def test_search_by_halving_and_by_optuna(responses, pool):
    pytest.importorskip("optuna", reason="Optuna is absent: pip install 'crfbench[optuna]'")
    assert search_architectures(responses, SMALL, 1, "halving", epochs=12, executor=pool).table["epochs"].iloc[0] == 12
    assert len(search_architectures(responses, SMALL, 1, "optuna", epochs=2, executor=pool).table) == 6


def test_a_second_call_trains_nothing_again(responses, pool, tmp_path):
    class Refusing(ThreadPoolExecutor):
        def submit(self, *args, **kwargs):
            raise AssertionError("nothing should be left to train")

    path = tmp_path / "j.jsonl"
    first = search_architectures(responses, SMALL, epochs=2, executor=pool, journal=path)
    again = search_architectures(responses, SMALL, epochs=2, executor=Refusing(), journal=path)
    assert again.table.equals(first.table)


def test_directions_folds_and_seeds_are_different_searches(responses, pool, tmp_path):
    search_architectures(responses, SMALL, epochs=1, executor=pool, journal=tmp_path / "j")
    for other in ({"direction": "forward"}, {"folds": "grouped"}, {"seed": 1}):
        with pytest.raises(InputError, match=r"j belongs to a search with .*; use another journal"):
            search_architectures(responses, SMALL, epochs=1, executor=pool, journal=tmp_path / "j", **other)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"m": 0}, "m=0 is out of range"),
        ({"folds": "odd"}, "use one of random, grouped"),
        ({"direction": "up"}, "use one of forward, inverse"),
        ({"strategy": "best"}, "use one of grid"),
        ({"epochs": 0}, "epochs=0 is out of range"),
    ],
)
def test_wrong_arguments_are_refused(responses, pool, wrong, message):
    with pytest.raises(InputError, match=message):
        search_architectures(responses, SMALL, executor=pool, **wrong)


def test_too_few_curves_are_refused(responses, pool):
    with pytest.raises(InputError, match="5 responses are too few"):
        search_architectures(responses.select(range(5)), SMALL, executor=pool)


def test_progress_tells_the_time_left(responses, pool, capsys):
    search_architectures(responses, SMALL, epochs=2, executor=pool, progress=True)
    shown = capsys.readouterr().err
    assert "6 of 6 architectures" in shown
    assert "left]" in shown


# ---- interruptions


class Interrupted(ThreadPoolExecutor):
    """Stands for a user who presses Ctrl-C after some stacks."""

    def __init__(self, after):
        super().__init__(1)
        self.left, self.waiting = after, []

    def submit(self, *args, **kwargs):
        future: Future = Future()
        if self.left:
            self.left -= 1
            return super().submit(*args, **kwargs)
        self.waiting.append(future)
        if len(self.waiting) == 1:
            future.set_exception(KeyboardInterrupt())
        return future


def test_ctrl_c_keeps_what_is_done_and_cancels_the_rest(responses, pool, tmp_path):
    path = tmp_path / "j.jsonl"
    with Interrupted(1) as executor, pytest.raises(KeyboardInterrupt):
        search_architectures(responses, SMALL, epochs=2, executor=executor, journal=path)
    assert all(future.cancelled() for future in executor.waiting[1:])
    whole = search_architectures(responses, SMALL, epochs=2, executor=pool, journal=path).table
    assert whole.drop(columns="seconds").equals(
        search_architectures(responses, SMALL, epochs=2, executor=pool).table.drop(columns="seconds")
    )


SCRIPT = """
import sys
from crfbench import load_responses, search_architectures
from crfbench.search import SearchSpace
responses, space = load_responses("opencrf").select(range(30)), SearchSpace(h1=tuple(range(5, 125)), h2=(0,), h3=(0,))
search_architectures(responses, space, epochs=60, journal=sys.argv[1])
"""


def start_script(tmp_path):
    """Run the script from stdin, wait until three results are on the disk, and return process, journal and workers."""
    path, script = tmp_path / "journal.jsonl", tmp_path / "script.py"
    script.write_text(SCRIPT)
    with script.open() as stdin:
        process = subprocess.Popen(
            [sys.executable, "-", path], stdin=stdin, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
    while not (path.exists() and path.read_bytes().count(b"\n") >= 4):
        assert process.poll() is None, f"no results came: {process.stderr.read()[-2000:]}"
        time.sleep(0.05)
    workers = children(process.pid)
    assert len(workers) >= 1
    return process, path, workers


def children(pid):
    listed = subprocess.run(["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True, check=False)
    return [int(line) for line in listed.stdout.split()]


def alive(pid):
    shown = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True, check=False).stdout
    return bool(shown.strip()) and "Z" not in shown


def stop(process, workers, sign):
    """Send a signal to the process, as Ctrl-C to its group, and wait until the last of its workers has ended."""
    send = os.killpg if sign == signal.SIGINT else os.kill
    send(process.pid, sign)
    told = process.communicate()[1]
    while any(map(alive, workers)):
        time.sleep(0.05)
    return told


@pytest.mark.parametrize(
    "sign",
    [pytest.param(signal.SIGKILL, id="kill -9"), pytest.param(signal.SIGINT, id="Ctrl-C", marks=pytest.mark.slow)],
)
def test_an_end_in_the_middle_loses_nothing_and_leaves_no_process(tmp_path, sign):
    process, path, workers = start_script(tmp_path)
    told = stop(process, workers, sign)
    assert sign == signal.SIGKILL or (told.count("Traceback") == 1 and told.endswith("KeyboardInterrupt\n"))
    held = [line for line in path.read_bytes().splitlines(keepends=True) if line.endswith(b"\n")]
    assert len(held) >= 4
    settings_ = json.loads(held[0])["settings"]
    assert [outcome.epochs for outcome in Journal(path, settings_).outcomes] == [60] * (len(held) - 1)


def test_a_worker_that_crashes_is_told_as_what_it_is(responses):
    class Crashing(ThreadPoolExecutor):
        def submit(self, *args, **kwargs):
            future: Future = Future()
            future.set_exception(BrokenExecutor("killed. Perhaps by its lack of memory."))
            return future

    with pytest.raises(WorkerError, match=r"did not start or ended by itself \(killed\); use the same journal"):
        search_architectures(responses, SMALL, epochs=1, executor=Crashing())


def test_a_worker_that_cannot_start_is_told_as_what_it_is():
    code = (
        "import sys; from crfbench import load_responses, search_architectures; sys.executable = 'nowhere'; "
        "search_architectures(load_responses('opencrf').select(range(30)), m=1, epochs=1)"
    )
    failed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert failed.returncode == 1
    assert "WorkerError: a worker process did not start or ended by itself" in failed.stderr


def test_a_damaged_last_line_is_cut_off(tmp_path):
    path, outcome = tmp_path / "j", Outcome((10, 5), 3, (0.1, 0.2), (0.3, 0.4), 1.5)
    Journal(path, {"seed": 0}).append(outcome)
    whole = path.read_bytes()
    path.write_bytes(whole + whole.splitlines()[-1][:20])
    journal = Journal(path, {"seed": 0})
    assert journal.outcomes == [outcome]
    assert path.read_bytes() == whole
    journal.append(replace(outcome, hidden=(3,)))
    assert [o.hidden for o in Journal(path, {"seed": 0}).outcomes] == [(10, 5), (3,)]


@given(cut=st.integers(0, 400))
def test_a_journal_cut_anywhere_opens_again(tmp_path_factory, cut):
    path = tmp_path_factory.mktemp("journal") / "j"
    journal = Journal(path, {"seed": 0})
    for i in range(3):
        journal.append(Outcome((10 + i,), 3, (0.1,), (0.3,), 1.5))
    whole = path.read_bytes()
    path.write_bytes(whole[:cut])
    assert Journal(path, {"seed": 0}).outcomes == journal.outcomes[: max(whole[:cut].count(b"\n") - 1, 0)]


@pytest.mark.parametrize("content", [b"[]\n", b"{}\n", b"hello\n", b'{"settings": {}}\n{"hidden": 3}\n', b"\xff\xfe\n"])
def test_other_files_are_no_journals_and_stay_as_they_are(tmp_path, content):
    path = tmp_path / "other"
    path.write_bytes(content)
    with pytest.raises(FormatError, match="other is not a journal of a search"):
        Journal(path, {})
    assert path.read_bytes() == content


# ---- executors


def test_threads_do(responses):
    with ThreadPoolExecutor(2) as executor:
        table = search_architectures(responses, SMALL, epochs=2, executor=executor).table
    assert len(table) == 6
    assert threading.active_count() < 20


@pytest.mark.slow
def test_dask_workers_do(responses, pool):
    distributed = pytest.importorskip("distributed", reason="dask is absent: pip install 'crfbench[cluster]'")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster,
        distributed.Client(cluster) as client,
    ):
        table = search_architectures(responses, SMALL, epochs=2, executor=client.get_executor()).table
    here = search_architectures(responses, SMALL, epochs=2, executor=pool).table
    assert table.drop(columns="seconds").equals(here.drop(columns="seconds"))


def test_wide_candidates_take_smaller_steps():
    rates = [search_config((width,)).learning_rate for width in (10, 50, 200, 500)]
    assert rates[0] == rates[1] == 2 * rates[2] > rates[3]


def test_curves_may_be_any_valid_ones(pool):
    from crfbench.datasets import Responses

    gammas = np.stack([GRID**g for g in np.linspace(0.4, 2.4, 9)])
    labels = tuple(f"g{i}" for i in range(9))
    responses = Responses("gammas", gammas, labels, labels, labels, labels, labels)
    result = search_architectures(responses, SMALL, m=1, direction="forward", folds="grouped", epochs=60, executor=pool)
    assert result.table["mse"].iloc[0] < 0.03


def test_looking_at_results_needs_no_torch():
    code = "import sys, crfbench.search.result, crfbench.widgets.search_explorer; print('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


# ---- the recorded search


@pytest.mark.dorf
def test_one_recorded_candidate_is_recomputed(dorf_curves):
    recorded, _ = load_recorded("search_dorf")
    assert len(recorded) == 156
    curves = dorf_curves.in_direction("inverse").astype(np.float32)
    base = Stack(curves, "inverse", make_folds(dorf_curves, "random", 0), (), replace(CONFIG, seed=0), BLOCKS)
    (stack,) = pack([((20,), 500)], base)
    row = recorded.query("h1 == 20 and h2 == 0").iloc[0]
    assert np.mean(train_stack(stack)[0].mse) == pytest.approx(row["mse"], rel=0.02)
