"""Every figure of the report: what it needs, how its table is made, how it is drawn. A new figure
is one more entry.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from nearlift.manifest.campaign import Campaign
from nearlift.products import (
    CRASH_MAP,
    CRASH_RATES,
    DETECTION,
    DIAGNOSIS,
    DOWNWASH,
    DOWNWASH_PROFILE,
    FIT,
    FLIGHTS,
    FLOW,
    FLOW_FIELDS,
    FLOW_TOPOLOGY,
    LIFT,
    LOOP_RESIDUALS,
    POSTERIOR,
    PROFILES,
    PROXIMITY,
    ROUTES,
    SAFETY,
    TRIALS,
    Product,
)
from nearlift.report.evidence import Columns, Evidence
from nearlift.report.figures import (
    assumptions,
    budget,
    corner,
    crash_map,
    detection,
    fig3,
    fig4,
    fig5,
    fig6,
    flow_topology,
    prior_posterior,
    profiles,
    routes,
    safety,
)
from nearlift.report.figures.diagnosis import caption as loop_text
from nearlift.report.figures.diagnosis import drawing as draw_loop
from nearlift.report.figures.diagnosis import table as loop
from nearlift.report.figures.encoding import Draw
from nearlift.report.figures.fig2 import drawing as draw_fig2
from nearlift.report.figures.fig2 import table as fig2
from nearlift.report.figures.residuals import drawing as draw_residuals
from nearlift.report.figures.residuals import table as residuals


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
    asked : callable
        Whether a manifest's choices ask for it, beyond the stages that make its products; one that
        is not asked for is not missed.
    """

    name: str
    title: str
    summarise: Callable[[Evidence], Columns]
    draw: Draw
    needs: tuple[Product, ...]
    caption: Callable[[Evidence, Columns], str]
    alt: Callable[[Evidence, Columns], str]
    asked: Callable[[Campaign], bool] = lambda campaign: True


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
        draw=assumptions.draw,
        needs=(FIT,),
        caption=assumptions.caption,
        alt=assumptions.alt,
    ),
    FigureSpec(
        name="budget",
        title="Whose error it is",
        summarise=budget.summarise,
        draw=budget.draw,
        needs=(FIT,),
        caption=budget.caption,
        alt=budget.alt,
    ),
    FigureSpec(
        name="profiles",
        title="Profile likelihoods",
        summarise=profiles.summarise,
        draw=profiles.draw,
        needs=(FIT, PROFILES),
        caption=profiles.caption,
        alt=profiles.alt,
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
        draw=corner.draw,
        needs=(FIT, POSTERIOR),
        caption=corner.caption,
        alt=corner.alt,
    ),
    FigureSpec(
        name="prior_posterior",
        title="Prior against posterior",
        summarise=prior_posterior.summarise,
        draw=prior_posterior.draw,
        needs=(FIT, POSTERIOR),
        caption=prior_posterior.caption,
        alt=prior_posterior.alt,
    ),
    FigureSpec(
        name="fig3",
        title="Flow near ground and ceiling",
        summarise=fig3.summarise,
        draw=fig3.draw,
        needs=(DOWNWASH, DOWNWASH_PROFILE, FLOW_FIELDS, FLOW),
        caption=fig3.caption,
        alt=fig3.alt,
    ),
    FigureSpec(
        name="fig4",
        title="Airspeed less the control's",
        summarise=fig4.summarise,
        draw=fig4.draw,
        needs=(FLOW_FIELDS, FLOW),
        caption=fig4.caption,
        alt=fig4.alt,
    ),
    FigureSpec(
        name="fig5",
        title="Wake over a tilted ground",
        summarise=fig5.summarise,
        draw=fig5.draw,
        needs=(FLOW_FIELDS, FLOW_TOPOLOGY, FLOW),
        caption=fig5.caption,
        alt=fig5.alt,
    ),
    FigureSpec(
        name="flow_topology",
        title="The wake against tilt",
        summarise=flow_topology.summarise,
        draw=flow_topology.draw,
        needs=(FLOW_FIELDS, FLOW_TOPOLOGY, FLOW),
        caption=flow_topology.caption,
        alt=flow_topology.alt,
    ),
    FigureSpec(
        name="fig6",
        title="Crash rates and energy, as the paper has them",
        summarise=fig6.summarise,
        draw=fig6.draw,
        needs=(CRASH_RATES, FLIGHTS, SAFETY),
        caption=fig6.caption,
        alt=fig6.alt,
    ),
    FigureSpec(
        name="safety",
        title="Crash rates and energy of the fitted models",
        summarise=safety.summarise,
        draw=safety.draw,
        needs=(CRASH_RATES, SAFETY),
        caption=safety.caption,
        alt=safety.alt,
    ),
    FigureSpec(
        name="crash_map",
        title="Crash rate over dimensionless groups",
        summarise=crash_map.summarise,
        draw=crash_map.draw,
        needs=(CRASH_MAP, SAFETY),
        caption=crash_map.caption,
        alt=crash_map.alt,
        asked=lambda campaign: campaign.simulate is None or campaign.simulate.maps,
    ),
    FigureSpec(
        name="detection",
        title="How far away a boundary shows",
        summarise=detection.summarise,
        draw=detection.draw,
        needs=(DETECTION, PROXIMITY),
        caption=detection.caption,
        alt=detection.alt,
    ),
    FigureSpec(
        name="routes",
        title="Ways through the corridor",
        summarise=routes.summarise,
        draw=routes.draw,
        needs=(ROUTES, SAFETY),
        caption=routes.caption,
        alt=routes.alt,
        asked=lambda campaign: (
            campaign.simulate is not None and campaign.simulate.route is not None
        ),
    ),
)
