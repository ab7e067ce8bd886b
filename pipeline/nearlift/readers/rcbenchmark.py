"""RCbenchmark 1520, 1580 and 1585: CSV with a byte order mark, units in the names, a trailing
comma.

The unit of `Thrust` follows a preference of the user (gf, kgf, N): it is read from the header and
held against the manifest's. The clock of averaged step tests runs backwards between its first rows;
the order of the rows is kept.
"""

from __future__ import annotations

from nearlift.readers.stand import stand_reader

READER = stand_reader(
    name="rcbenchmark",
    title="RCbenchmark 15xx",
    known=lambda names: names >= {"time", "esc signal", "thrust", "voltage"},
    speeds=lambda name: name.startswith("motor") and "speed" in name,
    texts=("app message",),
)
