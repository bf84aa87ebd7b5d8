"""Names of constants and first lines of docstrings: today's numbers as limits that only fall."""

import ast
import re
from collections.abc import Iterator
from functools import cache

from tests.support.programs import ROOT

MAX_UNNAMED_QUANTITIES = 54
MAX_BAD_STARTS = 0
MAX_LONG_FIRST_LINES = 382
FIRST_LINE_LENGTH = 88
QUANTITIES = frozenset(
    re.findall(
        r"\w+",
        """
        ACCELERATION ACCELERATIONS AGE AMPLITUDE ANGLE ANGLES AREA AXES BANDWIDTH BAUD BETA BIAS BINS BITS
        BUDGET BYTES CADENCE CAPACITY CODE COEFFICIENT COLUMNS CONFIDENCE CONSTANT COST COUNT COVARIANCE CURRENT
        DECAY DECIMALS DELAY DENSITY DEPTH DIAMETER DIGITS DIMENSION DISTANCE DRAG DRIFT DURATION EPOCH EPSILON
        ERROR EXPONENT FACTOR FIELDS FORCE FRACTION FRAMES FREQUENCY GAIN GRAVITY HEADING HEIGHT HORIZON HZ ID
        IMAGES INDEX INERTIA INFLATION INTERVAL ITERATIONS JERK LAG LATENCY LATITUDE LENGTH LEVEL LIKELIHOOD
        LIMIT LONGITUDE MARGIN MASK MASS MESSAGES MODE MOMENT NEES NIS NOISE NS NUMBER OFFSET ORDER PARTICLES
        PERCENT PERIOD PHASE PIXELS PITCH PORT POWER PRESSURE PRIORITY PROBABILITY QUANTILE RADIUS RANGE RANK
        RATE RATIO RECORDS RESIDUAL RESOLUTION RETRIES ROLL ROWS SAMPLES SCALE SEED SEVERITY SHARE SIGMA SIGMAS
        SIZE SPACING SPAN SPEED SPREAD STATES STEP STEPS STIFFNESS TEMPERATURE THREADS THRESHOLD THRUST TILT
        TIME TIMEOUT TOLERANCE TORQUE TRACKS TYPE UNCERTAINTY VARIANCE VEHICLES VELOCITY VERSION VOLTAGE WALK
        WEIGHT WEIGHTS WIDTH WINDOW WORKERS YAW
        """,
    )
)


@cache
def trees() -> list[tuple[str, ast.Module]]:
    paths = sorted((ROOT / "onboard").rglob("*.py"))
    return [(path.relative_to(ROOT).as_posix(), ast.parse(path.read_text())) for path in paths]


def first_lines() -> Iterator[tuple[str, str]]:
    for name, tree in trees():
        for node in ast.walk(tree):
            if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            if text := ast.get_docstring(node):
                yield name, text.partition("\n\n")[0]


def test_a_numeric_constant_names_its_quantity() -> None:
    unnamed = [
        f"{name}: {target.id}"
        for name, tree in trees()
        for node in tree.body
        for target in ([node.target] if isinstance(node, ast.AnnAssign) else getattr(node, "targets", []))
        if isinstance(target, ast.Name) and target.id.isupper()
        if is_number(node.value)  # type: ignore[attr-defined]
        if not QUANTITIES & set(re.sub(r"(_(S|M|KG|N|G|PX|RAD|DEG))+$", "", target.id).split("_"))
    ]
    assert len(unnamed) <= MAX_UNNAMED_QUANTITIES, "\n".join(unnamed)


def is_number(node: ast.expr | None) -> bool:
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def test_a_docstring_begins_with_a_short_sentence() -> None:
    lines = [*first_lines()]
    starts = [f"{name}: {line}" for name, line in lines if re.match(r"(What|How|Where|That|Of|As|By) ", line)]
    long = [f"{name}: {line}" for name, line in lines if len(line) > FIRST_LINE_LENGTH or "\n" in line]
    assert len(starts) <= MAX_BAD_STARTS, "\n".join(starts)
    assert len(long) <= MAX_LONG_FIRST_LINES, "\n".join(long)
