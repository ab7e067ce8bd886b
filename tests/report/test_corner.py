"""Corner plot, bands and words, from draws made up here."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.campaign.choices import Report
from nearlift.report import curves
from nearlift.report.chapters import posterior as page
from nearlift.report.evidence import Evidence
from nearlift.report.figures import corner
from nearlift.report.figures.files import render
from nearlift.report.figures.style import Style
from nearlift.results.posterior import PosteriorSummary, SamplerCheck
from nearlift.rounding import plain
from nearlift.stages.fit import FIT, POSTERIOR

N = 4000
#: What a block of fit.json has besides, where a test says nothing of it.
NOT_ASKED = {
    **dict.fromkeys(("chi2", "rmse", "r2", "log_likelihood", "aic", "bic")),
    **dict.fromkeys(("dof", "n_trials"), 0),
    **dict.fromkeys(("degeneracies", "excluded", "undeclared"), ()),
    **{key: {} for key in ("L_inf_N", "profiles", "would_halve")},
    "covariance": {"names": ["K_b"], "values": [[0.01]]},
}


def evidence(K_b, levels=0.5):
    draws = {"K_b": K_b, "L_inf_N[0.5]": np.full(N, levels) if np.isscalar(levels) else levels}
    table = {
        "boundary": np.full(2 * N, "ground", dtype=object),
        "model": np.full(2 * N, "sanchez_cuevas", dtype=object),
        "chain": np.tile(np.repeat(np.arange(4), N // 4), 2),
        "draw": np.tile(np.arange(N // 4), 8),
        "parameter": np.repeat(np.array(list(draws), dtype=object), N),
        "value": np.concatenate(list(draws.values())),
        "log_prob": np.zeros(2 * N),
    }
    low, median, high = np.quantile(K_b, [0.05, 0.5, 0.95])
    entry = {
        "value": K_b.mean(),
        "u": K_b.std(),
        "median": median,
        "lo90": low,
        "hi90": high,
        "unit": "1",
        "ess": 4000.0,
        "tau": 1.0,
    }
    entry |= {
        "prior": {"text": "normal, mean 2, sd 4", "lo90": -4.5, "hi90": 8.5, "bounds": [0, 9]},
        **dict.fromkeys(("ess_tail", "at_low", "at_high", "width_over_fit")),
        "unlike_fit": "",
        "width_ratio": (high - low) / 13,
        "words": "",
    }
    said = {
        **dict.fromkeys(("ess", "tau", "acceptance", "noise_dof")),
        "model": "sanchez_cuevas",
        "data_sha256": "",
        "steps": 0,
        "L_inf_N": {},
        "sampler": "grid",
        "chains": 4,
        "draws": N // 4,
        "checks": [],
        "parameters": {"K_b": entry},
    }
    fitted = {
        **NOT_ASKED,
        "title": "Sanchez-Cuevas",
        "parameters": {
            "K_b": {k: entry[k] for k in ("value", "u", "lo90", "hi90")} | {"dof": None}
        },
        "posterior": said,
    }
    content = {
        "base": {"ground": "sanchez_cuevas"},
        "boundaries": {"ground": {"sanchez_cuevas": fitted}},
    }
    campaign = SimpleNamespace(report=Report())
    return Evidence(
        campaign=campaign, tables={POSTERIOR.file: table}, documents={FIT.file: content}
    )


def spread(seed=1, sd=0.3):
    return np.random.default_rng(seed).normal(2.0, sd, N)


def test_the_table_holds_the_draws_that_are_drawn():
    x = spread()
    found = evidence(x, 0.5 + 0.01 * spread(2))
    table = corner.table(found)
    mine = table[table["name"] == "K_b"]
    assert len(mine) == min(N, corner.MOST_DRAWS)
    np.testing.assert_array_equal(mine["value"], x[mine["draw"].astype(int)])
    assert set(table["name"]) == {"K_b", "L_inf_mN[0.5]"}
    caption = corner.caption(found, table)
    r = np.corrcoef(x, spread(2))[0, 1]
    assert f"strongest correlation {plain(r, 2)}, of K_b and L∞ at 50 %" in caption


@pytest.mark.parametrize("x", [np.full(N, 2.0), np.zeros(N)])
def test_the_corner_plot_survives_a_parameter_without_spread(x):
    table = corner.table(evidence(x))
    files = render(corner.draw, table, Style())
    assert files["png"].startswith(b"\x89PNG")


def test_a_band_holds_the_share_of_curves_that_it_says():
    found = evidence(spread())
    model = catalogue.model("sanchez_cuevas")
    known = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}
    z = np.array([0.2, 1.2, 3.0])
    low, middle, high = curves.posterior_quantiles(found, "ground", model, z, known)
    assert np.isnan(low[0])
    assert np.isnan(high[0])
    each = model(z[1:], **known, K_b=spread()[:, None]) - 1
    share = np.mean((each >= low[1:]) & (each <= high[1:]), axis=0)
    np.testing.assert_allclose(share, 0.9, atol=2e-3)
    assert np.mean(each < middle[1:], axis=0) == pytest.approx(0.5, abs=2e-3)
    assert curves.posterior_quantiles(Evidence(campaign=None), "ground", model, z, known) is None


def test_how_it_was_sampled_is_said_in_words():
    done = PosteriorSummary(
        model="a",
        data_sha256="",
        sampler="emcee",
        chains=100,
        draws=200,
        ess=5012.3,
        tau=8.3,
        acceptance=0.42,
        steps=600,
        noise_dof=math.inf,
        checks=(
            SamplerCheck(by="grid", apart=1.23, where=""),
            SamplerCheck(by="finer grid", apart=9.0, where="", unfit="too coarse for this shape"),
        ),
        parameters={},
        L_inf_N={},
    )
    told = page.how(done)
    assert "20000 draws by emcee, equal to 5012 independent ones." in told
    assert "600 steps of 100 walkers, 42 % accepted, τ = 8.3" in told
    assert "The grid agrees within 1.2 Monte Carlo standard errors" in told
    assert "The finer grid was no check: too coarse for this shape" in told
    without = dataclasses.replace(done, sampler="none")
    assert page.how(without) == "no free parameter"
    assert page.how(None) == "no posterior"
