"""Numbers as they are printed: rounded where their uncertainty begins."""

from __future__ import annotations

import math


def decimals(u: float) -> int:
    """Decimal places that show an uncertainty by one significant digit.

    It is shown by two if it begins with 1 or 2: rounding moves it by a sixth at most.
    """
    exponent = math.floor(math.log10(u))
    leading = round(u / 10**exponent, 6)
    return -exponent + (1 if leading < 2.95 else 0)


def plus_minus(value: float, u: float) -> str:
    """``2.06 ± 0.08``; without an uncertainty the value alone."""
    if not (math.isfinite(u) and u > 0):
        return plain(value)
    places = max(decimals(u), 0)
    return f"{fixed(value, places)} ± {u:.{places}f}"


def siunitx(value: float, u: float) -> str:
    """``2.06(8)``, as siunitx reads it; the uncertainty in units of the last digit."""
    if not (math.isfinite(u) and u > 0):
        return f"{value:.6g}"
    places = decimals(u)
    if places <= 0:
        return f"{value:.0f}({round(u)})"
    return f"{value:.{places}f}({round(u * 10**places)})"


def like(value: float, u: float) -> str:
    """A number that belongs to an uncertainty `u`, such as an end of its interval, with the same
    decimals.
    """
    if not (math.isfinite(value) and math.isfinite(u) and u > 0):
        return plain(value)
    return fixed(value, max(decimals(u), 0))


def plain(value: float, digits: int = 4) -> str:
    """A number to so many significant digits, with a true minus sign."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e+" in text and abs(value) < 1e6:
        # 130, not 1.3e+02
        text = f"{float(text):.0f}"
    return text.replace("-", "−") if "e" not in text else text


def fixed(value: float, places: int) -> str:
    """A number with so many decimals and a true minus sign; zero has no sign."""
    text = f"{value:.{places}f}"
    if float(text) == 0:
        text = text.lstrip("-")
    return text.replace("-", "−")


def signed(value: float, places: int) -> str:
    """A number with its sign, a plus too, as a correlation has it: ``−0.984``."""
    return ("+" if value >= 0 else "") + fixed(value, places)


def chance(p: float) -> str:
    """A p-value as text: ``p = 0.31``, or ``p < 0.001``."""
    return f"p = {p:.2g}" if p >= 1e-3 else "p < 0.001"


def bytes_text(count: int) -> str:
    """A number of bytes in words, as ``1.2 MB``."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= factor:
            return f"{count / factor:.3g} {unit}"
    return f"{count} bytes"
