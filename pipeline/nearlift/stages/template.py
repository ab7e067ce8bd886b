"""A campaign folder to fill in: a commented manifest and a schedule with its header."""

from __future__ import annotations

from pathlib import Path

MANIFEST = """\
# Facts about the rig and choices. Quantities are texts with a unit; nothing physical has a default.
schema = "nearlift.campaign/1"
name   = "{name}"                    # a slug; names the folders under processed/ and reports/

[vehicle]
name          = "FILL IN"
rotors        = 4                    # 1 for an isolated rotor
rotor_radius  = "FILL IN mm"
rotor_spacing = "FILL IN mm"         # ADJACENT axes; the opposite spacing is sqrt(2) times it unless rotor_diagonal is given
# throttle_map = {{ points = [["25 percent", "10885 rpm"], ["92 percent", "23500 rpm"]] }}   # for C_L, where no rpm is logged
mass          = "FILL IN g"

[rig]
held            = "throttle"         # throttle | voltage | rpm | power: what a trial holds constant
distance_datum  = "rotor plane"      # rotor plane | airframe | blade tip | rotor axis: what `distance` is measured from
distance_offset = "0 mm"             # datum to rotor plane, ADDED to every recorded distance
arena           = "FILL IN m"        # largest room dimension; bounds every distance
gravity         = "9.80665 m/s^2"

[load_cell]
sample_rate = "1000 Hz"
tare        = "2 s"                  # rotors-stopped head of every record; "0 s": already tared; "none": nobody knows
settle      = "0 s"                  # discarded after the tare
range       = "FILL IN kgf"
accuracy    = "FILL IN gf"           # half-width of the cell's departure from a straight line; never averages down

[records]
reader = "csv"                       # csv: one file per trial | parquet: one long table with a `trial` column | means: no records
files  = "trials/{{trial}}.csv"
force  = {{ column = "force", unit = "mN", sign = 1 }}   # sign = -1 where lift pulls the cell negative

[trials]
file = "trials.csv"                  # one row per trial, in the order in which they were run
[trials.units]
distance = "mm"
throttle = "percent"
start    = "s"

# A plan to weigh before it is run: `nearlift design` says what it could see, and draws a schedule.
# [design]
# distances = {{ ground = ["26 mm", "30 mm", "40 mm", "60 mm", "120 mm", "260 mm"] }}
# throttles = ["25 percent", "50 percent", "75 percent", "92 percent"]
# visits    = 15
# sessions  = 5
# noise     = {{ relative = "0.5 percent", force = "0.3 mN", height = "0.05 mm" }}

# What repeats do not show. One table per component; `scope` says what shares it.
# [[uncertainty]]
# name  = "distance datum"
# on    = "height"                   # height | force | gain
# value = "0.2 mm"                   # standard uncertainty
# scope = "boundary"                 # sample | trial | distance | throttle | session | boundary | campaign
"""
SCHEDULE = "trial,boundary,distance,throttle,start,session,approach\n"


def write_template(folder: Path) -> list[Path]:
    """Write campaign.toml, trials.csv and an empty trials/ into a new folder; returns what was written."""
    (folder / "trials").mkdir(parents=True)
    slug = "".join(c if c.isascii() and c.isalnum() else "-" for c in folder.resolve().name.lower()).strip("-") or "campaign"
    (folder / "campaign.toml").write_text(MANIFEST.format(name=slug), encoding="utf-8")
    (folder / "trials.csv").write_text(SCHEDULE, encoding="utf-8")
    return [folder / "campaign.toml", folder / "trials.csv", folder / "trials"]
