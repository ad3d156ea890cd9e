"""The Python side of SearchExplorer; tests/test_browser drives it on a page, tests/js its choice."""

import ipywidgets
import numpy as np
import pandas as pd
import pytest

from crfbench.errors import InputError
from crfbench.search import complexity
from crfbench.widgets import SearchExplorer

MSE = {(100,): 1.0, (50,): 1.1, (20,): 1.2, (10,): 1.3, (10, 10): 2.0}


@pytest.fixture
def table() -> pd.DataFrame:
    rows = [
        {
            **dict(zip(("h1", "h2", "h3"), (*hidden, 0, 0), strict=False)),
            "mse": mse,
            "mse_sd": 0.1 * mse,
            "rmse": np.sqrt(mse),
            "complexity": complexity(hidden),
            "epochs": 500,
        }
        for hidden, mse in MSE.items()
    ]
    return pd.DataFrame(rows).assign(rank=range(1, len(rows) + 1))


def test_chooses_the_least_complex_of_the_m_most_accurate(table):
    explorer = SearchExplorer(table, m=1)
    assert (explorer.m, explorer.chosen, explorer.focus) == (1, (100,), (100,))
    explorer.m = 4
    assert explorer.chosen == (10,)
    assert explorer.focus == (100,), "the name stays where it is"
    assert repr(explorer) == "SearchExplorer(5 candidates, m=4, chosen=(10,))"


def test_each_bar_stays_with_its_candidate(table):
    shuffled = table.sample(frac=1, random_state=0).reset_index(drop=True)
    explorer = SearchExplorer(shuffled, spread=shuffled["complexity"], m=2)
    assert all(candidate["bar"] == candidate["complexity"] for candidate in explorer._candidates)
    assert [candidate["mse"] for candidate in explorer._candidates] == sorted(table["mse"])


def test_the_page_is_told_of_the_pareto_front(table):
    front = [candidate["hidden"] for candidate in SearchExplorer(table, m=1)._candidates if candidate["front"]]
    assert front == [(100,), (50,), (20,), (10,)]


def test_m_and_focus_of_the_page_are_heard_of(table):
    explorer, heard = SearchExplorer(table, m=1), []
    explorer.observe(lambda change: heard.append((change.name, change.new)), ["m", "focus"])
    explorer.set_state({"m": 3})
    explorer.set_state({"focus": [10, 10]})
    explorer.set_state({"focus": [10, 10]})
    assert heard == [("m", 3), ("focus", (10, 10))]


def test_m_is_linked_to_a_slider_both_ways(table):
    explorer, slider = SearchExplorer(table, m=2), ipywidgets.IntSlider(min=1, max=5)
    ipywidgets.link((explorer, "m"), (slider, "value"))
    assert slider.value == 2
    slider.value = 4
    assert explorer.chosen == (10,)
    explorer.m = 3
    assert slider.value == 3


@pytest.mark.parametrize("m", [0, 6, 1.5, True, "2"])
def test_an_m_that_is_out_of_range_is_refused(table, m):
    with pytest.raises(InputError, match="use a whole number from 1 to 5"):
        SearchExplorer(table, m)
    explorer = SearchExplorer(table, 2)
    with pytest.raises(InputError, match="use a whole number from 1 to 5"):
        explorer.set_state({"m": m})
    assert explorer.m == 2


@pytest.mark.parametrize("focus", [(3,), (), 10, "10", None, ("10",)])
def test_a_focus_that_is_not_a_candidate_is_refused(table, focus):
    explorer = SearchExplorer(table, m=1)
    with pytest.raises(InputError, match=r"is not a candidate; use one of the table, such as \(100,\)"):
        explorer.focus = focus
    assert explorer.focus == (100,)


def test_other_tables_and_spreads_are_refused(table):
    with pytest.raises(InputError, match=r"without \['rank'\]"):
        SearchExplorer(table.drop(columns="rank"))
    with pytest.raises(InputError, match="the table has 0 rows"):
        SearchExplorer(table[:0])
    with pytest.raises(InputError, match=r"spread has the wrong shape \(1,\); use one number a candidate, \(5,\)"):
        SearchExplorer(table, spread=[1.0])


def test_the_front_end_needs_nothing_from_elsewhere():
    assert "import " not in SearchExplorer._esm
    assert "http" not in SearchExplorer._esm + SearchExplorer._css
