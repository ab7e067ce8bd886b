"""What a campaign's report rests on, as BibTeX: the sources of its models, and the programs that
its numbers went through.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from nearlift.declare import Declaration

#: Entries by key. Only fields that the publications themselves or the declarations give.
KNOWN = {
    "carter2021": (
        "@article{carter2021,\n  author = {Carter, D. J. and Bouchard, L. and Quinn, D. B.},\n "
        " title = {Influence of the Ground, Ceiling, and Sidewall on Micro-Quadrotors},\n  journal"
        " = {AIAA Journal},\n  year = {2021}\n}"
    ),
    "cheeseman1955": (
        "@techreport{cheeseman1955,\n  author = {Cheeseman, I. C. and Bennett, W. E.},\n  title ="
        " {The Effect of the Ground on a Helicopter Rotor in Forward Flight},\n  institution ="
        " {Aeronautical Research Council},\n  number = {R\\&M 3021},\n  year = {1955}\n}"
    ),
    "hayden1976": (
        "@inproceedings{hayden1976,\n  author = {Hayden, J. S.},\n"
        "  title = {The Effect of the Ground on Helicopter Hovering Power Required},\n"
        "  booktitle = {Proc. AHS 32nd Annual Forum},\n  year = {1976}\n}"
    ),
    "sanchezcuevas2017": (
        "@article{sanchezcuevas2017,\n  author = {Sanchez-Cuevas, P. and Heredia, G. and Ollero,"
        " A.},\n  title = {Characterization of the Aerodynamic Ground Effect and Its Influence in"
        " Multirotor Control},\n  journal = {International Journal of Aerospace Engineering},\n "
        " year = {2017},\n  doi = {10.1155/2017/1823056}\n}"
    ),
    "hsiao2019": (
        "@article{hsiao2019,\n  author = {Hsiao, Y. H. and Chirarattananon, P.},\n  title ="
        " {Ceiling Effects for Hybrid Aerial-Surface Locomotion of Small Rotorcraft},\n  journal ="
        " {IEEE/ASME Transactions on Mechatronics},\n  year = {2019},\n  doi ="
        " {10.1109/TMECH.2019.2929589}\n}"
    ),
    "jimenezcano2019": (
        "@article{jimenezcano2019,\n  author = {Jimenez-Cano, A. E. and Sanchez-Cuevas, P. J. and"
        " Grau, P. and Ollero, A. and Heredia, G.},\n  title = {Contact-Based Bridge Inspection"
        " Multirotors: Design, Modeling, and Control Considering the Ceiling Effect},\n  journal ="
        " {IEEE Robotics and Automation Letters},\n  volume = {4},\n  number = {4},\n  pages ="
        " {3561--3568},\n  year = {2019},\n  doi = {10.1109/LRA.2019.2928206}\n}"
    ),
    "gum2008": (
        "@techreport{gum2008,\n  author = {{Joint Committee for Guides in Metrology}},\n  title ="
        " {Evaluation of Measurement Data: Guide to the Expression of Uncertainty in"
        " Measurement},\n  number = {JCGM 100:2008},\n  institution = {BIPM},\n  year = {2008}\n}"
    ),
    "vehtari2021": (
        "@article{vehtari2021,\n  author = {Vehtari, Aki and Gelman, Andrew and Simpson, Daniel and"
        ' Carpenter, Bob and B{\\"u}rkner, Paul-Christian},\n  title = {Rank-Normalization,'
        " Folding, and Localization: An Improved {$\\hat R$} for Assessing Convergence of"
        " {MCMC}},\n  journal = {Bayesian Analysis},\n  volume = {16},\n  number = {2},\n  year ="
        " {2021},\n  doi = {10.1214/20-BA1221}\n}"
    ),
    "vehtari2024": (
        "@article{vehtari2024,\n  author = {Vehtari, Aki and Simpson, Daniel and Gelman, Andrew and"
        " Yao, Yuling and Gabry, Jonah},\n  title = {Pareto Smoothed Importance Sampling},\n "
        " journal = {Journal of Machine Learning Research},\n  volume = {25},\n  number = {72},\n "
        " year = {2024}\n}"
    ),
    "emcee": (
        "@article{emcee,\n  author = {Foreman-Mackey, Daniel and Hogg, David W. and Lang, Dustin"
        " and Goodman, Jonathan},\n  title = {emcee: The {MCMC} Hammer},\n  journal = {Publications"
        " of the Astronomical Society of the Pacific},\n  volume = {125},\n  year = {2013},\n  doi"
        " = {10.1086/670067}\n}"
    ),
    "numpy": (
        "@article{numpy,\n  author = {Harris, Charles R. and others},\n  title = {Array Programming"
        " with {NumPy}},\n  journal = {Nature},\n  volume = {585},\n  pages = {357--362},\n  year ="
        " {2020},\n  doi = {10.1038/s41586-020-2649-2}\n}"
    ),
    "scipy": (
        "@article{scipy,\n  author = {Virtanen, Pauli and others},\n  title = {{SciPy} 1.0:"
        " Fundamental Algorithms for Scientific Computing in {Python}},\n  journal = {Nature"
        " Methods},\n  volume = {17},\n  pages = {261--272},\n  year = {2020},\n  doi ="
        " {10.1038/s41592-019-0686-2}\n}"
    ),
    "lmfit": (
        "@misc{lmfit,\n  author = {Newville, Matthew and others},\n  title = {{LMFIT}: Non-Linear"
        " Least-Squares Minimization and Curve-Fitting for {Python}},\n  doi ="
        " {10.5281/zenodo.598352}\n}"
    ),
    "matplotlib": (
        "@article{matplotlib,\n  author = {Hunter, John D.},\n  title = {Matplotlib: A {2D}"
        " Graphics Environment},\n  journal = {Computing in Science \\& Engineering},\n  volume ="
        " {9},\n  number = {3},\n  pages = {90--95},\n  year = {2007},\n  doi ="
        " {10.1109/MCSE.2007.55}\n}"
    ),
}


def keys(declared: Declaration) -> tuple[str, ...]:
    """The entries that a model or an effect rests on; its own name where its source gives none."""
    return declared.source.bibtex or (declared.name,)


def bibtex(cited: Iterable[str], declared: Iterable[Declaration]) -> str:
    """The entries of these keys, each once, in their order."""
    by_name = {d.name: d for d in declared}
    return (
        "\n\n".join(KNOWN.get(key) or _declared(by_name[key]) for key in dict.fromkeys(cited))
        + "\n"
    )


def _declared(declaration: Declaration) -> str:
    citation = (
        re.sub(r"[\\{}%#~^]", " ", declaration.source.citation)
        .replace("&", r"\&")
        .replace("_", r"\_")
        .replace("$", r"\$")
    )
    lines = [
        f"@misc{{{declaration.name}",
        f"  title = {{{{{declaration.title}}}}}",
        f"  note = {{{citation}}}",
        *([f"  doi = {{{declaration.source.doi}}}"] if declaration.source.doi else []),
    ]
    return ",\n".join(lines) + "\n}"
