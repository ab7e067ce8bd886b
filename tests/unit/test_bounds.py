"""No pattern takes more than linear time on a stranger's text.

All run in a process of its own, since what hangs cannot be interrupted from within.
"""

import ast
import json
import subprocess
import sys
from pathlib import Path

import nearlift

PACKAGE = Path(nearlift.__file__).parent
#: A hang on any machine under any load: what is asked takes milliseconds, what is quadratic many
#: minutes.
TIME_S = 60


def run(code: str, *questions: object) -> dict[str, str]:
    """What `answer(*question)` of the code says of each question, by the question's first word, in
    one process.
    """
    asked = "import faulthandler, json, sys\n" + code + SERVE
    done = subprocess.run(
        [sys.executable, "-P", "-c", asked],
        input=json.dumps(questions),
        capture_output=True,
        text=True,
    )
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    hung = (
        ""
        if len(answers) == len(questions)
        else f"not within {TIME_S} s, or dead: {questions[len(answers)][0]}\n{done.stderr}"
    )
    return {**dict(answers), **({"hung": hung} if hung else {})}


#: A watchdog ends what holds the interpreter's lock, too.
SERVE = f"""
for question in json.load(sys.stdin):
    faulthandler.dump_traceback_later({TIME_S}, exit=True)
    print(json.dumps([question[0], answer(*question)]), flush=True)
"""


def patterns() -> list[tuple[str, str, str]]:
    """Every regular expression of the package: where it stands, how it is used, and itself.

    A pattern that is put together as it runs cannot be judged here. What is compiled is asked for
    in all ways in which its name is used.
    """
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and getattr(node.func.value, "id", "") == "re"
            ):
                where = f"{path.relative_to(PACKAGE).as_posix()}, line {node.lineno}, {len(found)}"
                assert isinstance(node.args[0], ast.Constant), f"{where}: {ast.unparse(node)}"
                found.append((where, node.func.attr, str(node.args[0].value)))
    return found


#: On 12,000 characters a linear pattern takes milliseconds of processor, a quadratic one seconds.
PUMP = r"""
import re, time
PIECES = [" ", "\t", "1", "1.", "1,", "1 ", "a", "a ", "a.", "a: ", "-", "#", "//", "(", "[", "{", '"', "'", '"a" ', "[a] ", "a [", "(a) ", "$a"]
HEADS = ["", "1 ", "a ", "a [", '"a" ', "2D-vector 1", "GridSize", "GridSize: {Width", "VARIABLES=", "powertrain 1 - force fz", "Fz1 = [", "z=["]
def answer(where, how, pattern):
    # a word is worth trying only where the pattern knows it
    heads = [head for head in HEADS if len(head) < 6 or head[:5] in pattern]
    pattern = re.compile(pattern)
    apply = pattern.search if how not in ("match", "fullmatch") else getattr(pattern, how)
    for piece in [*PIECES, *heads[1:]]:
        body = piece * (12_000 // len(piece)) + "\0!"
        for head in heads:
            began = time.process_time()
            apply(head + body)
            if time.process_time() - began > 0.3:
                return f"{how} of {pattern.pattern}: {head + piece!r} repeated"
    return ""
"""


def test_no_pattern_takes_more_than_linear_time():
    done = run(PUMP, *patterns())
    assert {where: slow for where, slow in done.items() if slow} == {}
