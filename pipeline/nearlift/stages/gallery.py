"""Every figure of the report: what it needs, how its table is made, how it is drawn. A new figure is one more entry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from nearlift.figures import assumptions as draw_assumptions
from nearlift.figures import corner as draw_corner
from nearlift.figures import fig2 as draw_fig2
from nearlift.figures import loop as draw_loop
from nearlift.figures import prior_posterior as draw_prior_posterior
from nearlift.figures import residuals as draw_residuals
from nearlift.figures.render import Draw
from nearlift.products import DIAGNOSIS, FIT, LIFT, LOOP_RESIDUALS, POSTERIOR, TRIALS, Product
from nearlift.summaries import assumptions, corner, fig2, loop, loop_text, prior_posterior, residuals
from nearlift.summaries.evidence import Columns, Evidence


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureSpec:
    """One figure. It is made when every product in `needs` exists, and its summary has rows.

    Attributes
    ----------
    name, title : str
        File name without suffix; heading.
    summarise : callable
        Evidence to the table of exactly what is drawn.
    draw : callable
        Table and style to a figure.
    needs : tuple of Product
    caption, alt : callable
        Evidence and table to text, its numbers computed from them.
    """

    name: str
    title: str
    summarise: Callable[[Evidence], Columns]
    draw: Draw
    needs: tuple[Product, ...]
    caption: Callable[[Evidence, Columns], str]
    alt: Callable[[Evidence, Columns], str]


FIGURES: tuple[FigureSpec, ...] = (
    FigureSpec(
        name="fig2",
        title="Lift change near each boundary",
        summarise=fig2.summarise,
        draw=draw_fig2.draw,
        needs=(TRIALS, LIFT, FIT),
        caption=fig2.caption,
        alt=fig2.alt,
    ),
    FigureSpec(
        name="diagnosis",
        title="The loop: residual, candidates, error, coefficient",
        summarise=loop.summarise,
        draw=draw_loop.draw,
        needs=(TRIALS, FIT, DIAGNOSIS, LOOP_RESIDUALS),
        caption=loop_text.caption,
        alt=loop_text.alt,
    ),
    FigureSpec(
        name="assumptions",
        title="Throttle, held quantity, rotor",
        summarise=assumptions.summarise,
        draw=draw_assumptions.draw,
        needs=(FIT,),
        caption=assumptions.caption,
        alt=assumptions.alt,
    ),
    FigureSpec(
        name="residuals",
        title="Residuals of the base model",
        summarise=residuals.summarise,
        draw=draw_residuals.draw,
        needs=(TRIALS, FIT),
        caption=residuals.caption,
        alt=residuals.alt,
    ),
    FigureSpec(
        name="corner",
        title="Posterior of the base models",
        summarise=corner.summarise,
        draw=draw_corner.draw,
        needs=(FIT, POSTERIOR),
        caption=corner.caption,
        alt=corner.alt,
    ),
    FigureSpec(
        name="prior_posterior",
        title="Prior against posterior",
        summarise=prior_posterior.summarise,
        draw=draw_prior_posterior.draw,
        needs=(FIT, POSTERIOR),
        caption=prior_posterior.caption,
        alt=prior_posterior.alt,
    ),
)
